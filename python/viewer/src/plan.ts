import type { SceneView, ViewData } from "./scene/view";
import type { Selection } from "./selection";
export function createPlan(_host: HTMLElement, _data: ViewData, _selection: Selection): SceneView {
  throw new Error("todo");
}
