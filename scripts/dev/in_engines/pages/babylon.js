// SPDX-License-Identifier: GPL-3.0-or-later
// Babylon.js: PBRMaterial in its debug mode that shows the normal.
import "@babylonjs/core/Loading/loadingScreen.js";
import "@babylonjs/core/Materials/PBR/pbrMaterial.js";
import "@babylonjs/loaders/glTF/2.0/index.js";
import { Engine } from "@babylonjs/core/Engines/engine.js";
import { LoadAssetContainerAsync } from "@babylonjs/core/Loading/sceneLoader.js";
import { Color4 } from "@babylonjs/core/Maths/math.color.js";
import { Scene } from "@babylonjs/core/scene.js";

const NORMALS = 5;

export async function start(canvas, job) {
  const engine = new Engine(canvas.gl, false, {}, false);
  return {
    async load(url, kind) {
      const scene = new Scene(engine);
      scene.useRightHandedSystem = job.right_handed;
      scene.clearColor = new Color4(0, 0, 0, 0);
      const loaded = await LoadAssetContainerAsync(url, scene);
      loaded.addAllToScene();
      for (const material of loaded.materials) {
        if (material.getClassName() !== "PBRMaterial") throw new Error(`${material.getClassName()} instead of PBRMaterial`);
        material.debugMode = NORMALS;
        material.debugLimit = -1;
        material.useObjectSpaceNormalMap = kind === "object";
      }
      return {
        async render(view) {
          scene.activeCamera = loaded.cameras.find((one) => one.name === `view${view}`);
          await scene.whenReadyAsync();
          canvas.bind();
          scene.render();
          return canvas.read();
        },
        free() {
          scene.dispose();
        },
      };
    },
  };
}
