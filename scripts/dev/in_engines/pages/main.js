// SPDX-License-Identifier: GPL-3.0-or-later
// Renders each model of /job in the engine that the job names, and posts pictures as floats, and the tangents it has loaded.
import { FloatCanvas } from "./float_canvas.js";

const post = (path, body) => fetch(path, { method: "POST", body });

async function main() {
  const job = await (await fetch("/job")).json();
  const engine = await import(`./${job.engine}.js`);
  const canvas = new FloatCanvas(job.size);
  const renderer = await engine.start(canvas, job);
  for (const model of job.models) {
    const map = model.map && `/map/${model.name}.${model.map}`;
    const shown = await renderer.load(`/glb/${model.name}.glb`, model.kind, map);
    for (let view = 0; view < job.views; view++) {
      for (const output of model.outputs) {
        await post(`/result/${model.name}/${view}/${output}`, await shown.render(view, output));
      }
    }
    await post(`/tangents/${model.name}`, JSON.stringify(shown.tangents().map((one) => one && Array.from(one))));
    shown.free();
  }
  await post("/done", "");
}

addEventListener("unhandledrejection", (event) => post("/failed", String(event.reason?.stack ?? event.reason)));
addEventListener("error", (event) => post("/failed", `${event.message} (${event.filename}:${event.lineno})`));
main();
