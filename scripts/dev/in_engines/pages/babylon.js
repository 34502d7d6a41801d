// SPDX-License-Identifier: GPL-3.0-or-later
// Babylon.js: PBRMaterial in its debug modes.
import "@babylonjs/core/Loading/loadingScreen.js";
import "@babylonjs/core/Materials/PBR/pbrMaterial.js";
import "@babylonjs/loaders/glTF/2.0/index.js";
import { Engine } from "@babylonjs/core/Engines/engine.js";
import { LoadAssetContainerAsync } from "@babylonjs/core/Loading/sceneLoader.js";
import { Color4 } from "@babylonjs/core/Maths/math.color.js";
import { Scene } from "@babylonjs/core/scene.js";

const NORMAL = 5;
const ALBEDO_TEXTURE = 20;
const SURFACE = [21, 63, 62]; // occlusion, roughness, metallic
const fromSrgb = (value) => (value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4);
const fromGamma = (value) => value ** 2.2;

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
        material.debugLimit = -1;
        material.useObjectSpaceNormalMap = kind === "object";
      }
      const shown = async (mode) => {
        for (const material of loaded.materials) material.debugMode = mode;
        await scene.whenReadyAsync();
        canvas.bind();
        scene.render();
        return canvas.read();
      };
      return {
        tangents: () => loaded.meshes.filter((one) => one.getTotalVertices()).map((one) => one.getVerticesData("tangent")),
        async render(view, output) {
          scene.activeCamera = loaded.cameras.find((one) => one.name === `view${view}`);
          if (output === "normal") return shown(NORMAL);
          if (output === "surface") {
            const pictures = [];
            for (const mode of SURFACE) pictures.push(await shown(mode));
            return pictures[0].map((value, at) => (at % 4 < 3 ? pictures[at % 4][at] : value));
          }
          // The mode shows a texture that the shader decodes as it is, and one that is linear there with a gamma.
          const decoded = loaded.materials.every((one) => one.albedoTexture.gammaSpace) ? fromSrgb : fromGamma;
          return (await shown(ALBEDO_TEXTURE)).map((value, at) => (at % 4 < 3 ? decoded(value) : value));
        },
        free() {
          scene.dispose();
        },
      };
    },
  };
}
