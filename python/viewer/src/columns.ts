// Lists the columns of the table: how each is headed, sorted and written.
import { statusLabel } from "./colors";
import { axesText, mainSystem, positionTexts } from "./coordinates";
import type { Queries, Summary } from "./data";
import { visibleText } from "./dom";
import * as format from "./format";

export interface Column {
  id: string;
  label: string;
  explanation: string;
  width: number; // at least, in rem
  growth: number; // share of the room that is left
  kind: "text" | "status" | "confidence" | "number";
  isWorstLow: boolean; // the first click on the header sorts the worst first
  text(query: number): string;
  key(query: number): number; // NaN sorts last
}

// Returns each text's rank in alphabetical order, computed when it is first asked for.
function ranks(texts: string[]): (query: number) => number {
  let rank: Float64Array | null = null;
  return (query) => {
    if (!rank) {
      const order = Uint32Array.from(texts, (_, i) => i).sort((a, b) =>
        texts[a] < texts[b] ? -1 : +(texts[a] > texts[b]),
      );
      rank = new Float64Array(texts.length);
      for (let i = 0, value = -1; i < order.length; i++) {
        if (i === 0 || texts[order[i]] !== texts[order[i - 1]]) value = i;
        rank[order[i]] = texts[order[i]] === "" ? NaN : value;
      }
    }
    return rank[query];
  };
}

function numberColumn(
  id: string,
  label: string,
  explanation: string,
  values: ArrayLike<number>,
  text: (value: number) => string,
  { isWorstLow = false, width = 4.8 } = {},
): Column {
  return {
    id,
    label,
    explanation,
    width,
    growth: 1,
    kind: "number",
    isWorstLow,
    text: (query) => text(values[query]),
    key: (query) => (values[query] < 0 ? NaN : values[query]),
  };
}

export const EXPLANATIONS = {
  confidence: "Estimated probability that the position is right; computed from the evidence, without the true pose.",
  positionStddev:
    "Standard deviation of the position in its least certain direction; two thirds of the errors in this direction are smaller.",
  rotationStddev: "Standard deviation of the orientation, about its least certain axis.",
  positionError: "Distance to the true position.",
  rotationError: "Angle to the true orientation.",
  tracks: "Scene points that the pose rests on: each is seen in the query and in database images.",
  reprojection: "How far, typically, the scene points fall from where the query shows them.",
  images: "Database images with which the query was localized.",
};

// Returns a width for texts of these lengths, beside something that is `extra` rem wide.
function textWidth(texts: string[], extra: number): number {
  const longest = texts.reduce((max, { length }) => Math.max(max, length), 6);
  return Math.min(13, Math.max(7, 1 + extra + 0.53 * longest));
}

function textColumns(queries: Queries, summary: Summary): Column[] {
  const labels = summary.statuses.map(({ name }) => statusLabel(name));
  const base = { explanation: "", isWorstLow: true, growth: 0 };
  return [
    {
      ...base,
      id: "name",
      label: "Query",
      width: Math.min(12, textWidth(queries.names, 0)),
      growth: 1,
      kind: "text",
      text: (query) => visibleText(queries.names[query]),
      key: ranks(queries.names),
    },
    {
      ...base,
      id: "status",
      label: "Status",
      width: textWidth(labels, 1.5),
      kind: "status",
      isWorstLow: false,
      text: (query) => labels[queries.status[query]],
      key: (query) => queries.status[query],
    },
    {
      ...base,
      id: "confidence",
      label: "Confidence",
      explanation: EXPLANATIONS.confidence,
      width: 7.4,
      kind: "confidence",
      text: (query) => format.formatConfidence(queries.confidence[query]),
      key: (query) => queries.confidence[query],
    },
  ];
}

// Returns the column that says where each query is, or why that is not known.
function answerColumn(queries: Queries): Column {
  const system = mainSystem(queries);
  const { name } = queries.systems[system];
  const isNamedByAxes = system < 2; // coordinates of the model, or latitude and longitude
  return {
    id: "position",
    label: (isNamedByAxes ? "" : `${name}: `) + axesText(queries.systems[system]),
    explanation: "Where the photo was taken; or why the query has no position, or none to rely on.",
    width: 16.2,
    growth: 8,
    kind: "text",
    isWorstLow: true,
    text: (query) => positionTexts(queries, query, system)?.join(", ") ?? queries.reasons[query],
    key: ranks(queries.reasons),
  };
}

const TABLE_WIDTH = 88; // rem, in a window of 1280 pixels

// Returns the columns that have a value in this run. Where there is room, the whole position can be read on a phone, too.
export function tableColumns(queries: Queries, summary: Summary): Column[] {
  const length = (value: number) => format.formatLength(value, summary);
  const degrees = (value: number) => format.formatDegrees(value);
  const [wide, count] = [{ width: 5.9 }, { width: 4.2, isWorstLow: true }];
  const numbers = [
    numberColumn("positionError", "Pos. error", EXPLANATIONS.positionError, queries.positionError, length, wide),
    numberColumn("rotationError", "Rot. error", EXPLANATIONS.rotationError, queries.rotationErrorDeg, degrees, wide),
    numberColumn("positionStddev", "Pos. \u03c3", EXPLANATIONS.positionStddev, queries.positionStddev, length, { width: 5.6 }),
    numberColumn("rotationStddev", "Rot. \u03c3", EXPLANATIONS.rotationStddev, queries.rotationStddevDeg, degrees),
    numberColumn("tracks", "Points", EXPLANATIONS.tracks, queries.numTracks, format.formatCount, count),
    numberColumn(
      "reprojection",
      "Reproj.",
      EXPLANATIONS.reprojection,
      queries.reprojectionErrorPx,
      format.formatPixels,
    ),
    numberColumn("images", "Images", EXPLANATIONS.images, queries.numImages, format.formatCount, count),
    numberColumn("seconds", "Time", "Computing time of this query.", queries.seconds, format.formatSeconds, { width: 4.2 }),
  ];
  const hasValue = (column: Column) => queries.names.some((_, query) => !Number.isNaN(column.key(query)));
  const [name, ...others] = textColumns(queries, summary);
  const answer = answerColumn(queries);
  const columns = [name, answer, ...others, ...numbers.filter(hasValue)];
  const spare = TABLE_WIDTH - columns.reduce((sum, { width }) => sum + width, 0);
  const longest = queries.names.reduce((max, _, query) => {
    const position = positionTexts(queries, query, mainSystem(queries));
    return Math.max(max, position === null ? 0 : position.join(", ").length);
  }, 0);
  answer.width += Math.max(0, Math.min(spare, 1 + 0.53 * longest - answer.width));
  return columns;
}
