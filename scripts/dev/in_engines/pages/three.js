// SPDX-License-Identifier: GPL-3.0-or-later
// three.js: MeshStandardMaterial, with its normal as the color.
import * as THREE from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";

const END = "#include <dithering_fragment>";
const SHOW = "\ngl_FragColor = vec4(inverseTransformDirection(normal, viewMatrix) * 0.5 + 0.5, 1.0);\n";

export async function start(canvas) {
  const renderer = new THREE.WebGLRenderer({ canvas: canvas.canvas, context: canvas.gl });
  renderer.setSize(canvas.size, canvas.size, false);
  renderer.setClearColor(0, 0);
  return {
    async load(url, kind) {
      const gltf = await new GLTFLoader().loadAsync(url);
      gltf.scene.traverse(({ material }) => {
        if (!material) return;
        if (!material.isMeshStandardMaterial) throw new Error(`${material.type} instead of MeshStandardMaterial`);
        if (kind === "object") material.normalMapType = THREE.ObjectSpaceNormalMap;
        material.onBeforeCompile = (shader) => {
          if (!shader.fragmentShader.includes(END)) throw new Error("the shader of three.js has another end");
          shader.fragmentShader = shader.fragmentShader.replace(END, END + SHOW);
        };
      });
      return {
        render(view) {
          canvas.bind();
          renderer.render(gltf.scene, gltf.cameras[view]);
          return canvas.read();
        },
        free() {
          gltf.scene.traverse((one) => {
            one.geometry?.dispose();
            one.material?.normalMap?.dispose();
            one.material?.dispose();
          });
        },
      };
    },
  };
}
