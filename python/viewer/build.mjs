// Builds viewer.js, viewer.css and viewer_licenses.txt of the report page.
// `node build.mjs [FOLDER]` writes them to FOLDER, by default python/colmap_lazyloc/report.
import { mkdirSync, readFileSync, writeFileSync } from "node:fs";
import { dirname, join, resolve } from "node:path";
import { fileURLToPath } from "node:url";
import { build } from "esbuild";

const here = dirname(fileURLToPath(import.meta.url));
const folder = resolve(process.argv[2] ?? join(here, "../colmap_lazyloc/report"));

// Names the packages whose code is in the bundle, by the files that esbuild read.
function bundledPackages(metafile) {
  const names = new Set();
  for (const [file, { bytesInOutput }] of Object.entries(Object.values(metafile.outputs)[0].inputs)) {
    const match = /node_modules\/((?:@[^/]+\/)?[^/]+)\//.exec(file);
    if (match && bytesInOutput > 0) names.add(match[1]);
  }
  return [...names].sort();
}

function license(name) {
  const root = join(here, "node_modules", name);
  const { version } = JSON.parse(readFileSync(join(root, "package.json"), "utf8"));
  return `${name} ${version}\n\n${readFileSync(join(root, "LICENSE"), "utf8").trim()}\n`;
}

mkdirSync(folder, { recursive: true });
const result = await build({
  absWorkingDir: here,
  entryPoints: ["src/main.ts"],
  bundle: true,
  format: "iife",
  minify: true,
  target: "es2020",
  charset: "ascii",
  legalComments: "none",
  metafile: true,
  write: false,
  logLevel: "warning",
});
const packages = bundledPackages(result.metafile);
const banner = `/* Built by scripts/build_viewer.sh from python/viewer; licences: viewer_licenses.txt */\n`;
// The page holds this script, so that its text must not end the element.
const script = result.outputFiles[0].text.replaceAll("</script", "<\\/script").replaceAll("<!--", "\\x3c!--");
writeFileSync(join(folder, "viewer.js"), banner + script);
const styles = ["src/style.css", "src/scene/scene.css"].map((file) => readFileSync(join(here, file), "utf8"));
writeFileSync(join(folder, "viewer.css"), styles.join("\n"));
writeFileSync(join(folder, "viewer_licenses.txt"), packages.map(license).join(`\n${"-".repeat(80)}\n\n`));
console.log(`${folder}: viewer.js ${(script.length / 1000).toFixed(0)} kB with ${packages.join(", ") || "no packages"}`);
