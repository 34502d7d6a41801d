// SPDX-License-Identifier: GPL-3.0-or-later
// three.js: MeshStandardMaterial, with its normal, its base color, or occlusion, roughness and metallic as the color.
import * as THREE from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { KTX2Loader } from "three/addons/loaders/KTX2Loader.js";

const END = "#include <dithering_fragment>";
const START = "uniform float opacity;";
const SHOW = `
vec3 shown = inverseTransformDirection(normal, viewMatrix) * 0.5 + 0.5;
if (output_index == 1) shown = diffuseColor.rgb;
if (output_index == 2) shown = vec3(1.0, roughnessFactor, metalnessFactor);
#ifdef USE_AOMAP
if (output_index == 2) shown.r = ambientOcclusion;
#endif
gl_FragColor = vec4(shown, 1.0);
`;
const OUTPUTS = ["normal", "color", "surface"];

export async function start(canvas) {
  const renderer = new THREE.WebGLRenderer({ canvas: canvas.canvas, context: canvas.gl });
  renderer.setSize(canvas.size, canvas.size, false);
  renderer.setClearColor(0, 0);
  const blocks = new KTX2Loader().setTranscoderPath("/npm/three/examples/jsm/libs/basis/").detectSupport(renderer);
  return {
    async load(url, kind, map) {
      const gltf = await new GLTFLoader().setKTX2Loader(blocks).loadAsync(url);
      const texture = map && (await textureAt(map, blocks));
      const index = { value: 0 };
      const tangents = [];
      gltf.scene.traverse(({ geometry }) => geometry && tangents.push(geometry.attributes.tangent?.array ?? null));
      gltf.scene.traverse(({ material }) => {
        if (!material) return;
        if (!material.isMeshStandardMaterial) throw new Error(`${material.type} instead of MeshStandardMaterial`);
        if (texture) material.normalMap = texture;
        if (kind === "object") material.normalMapType = THREE.ObjectSpaceNormalMap;
        material.onBeforeCompile = (shader) => {
          for (const part of [START, END]) {
            if (!shader.fragmentShader.includes(part)) throw new Error(`the shader of three.js has no ${part}`);
          }
          shader.uniforms.output_index = index;
          shader.fragmentShader = shader.fragmentShader
            .replace(START, `${START}\nuniform int output_index;`)
            .replace(END, END + SHOW);
        };
      });
      return {
        tangents: () => tangents,
        render(view, output) {
          index.value = OUTPUTS.indexOf(output);
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

async function textureAt(url, blocks) {
  let texture;
  if (url.endsWith(".f32")) {
    const data = new Float32Array(await (await fetch(url)).arrayBuffer());
    const size = Math.sqrt(data.length / 4);
    texture = new THREE.DataTexture(data, size, size, THREE.RGBAFormat, THREE.FloatType);
  } else if (url.endsWith(".ktx2")) {
    texture = await blocks.loadAsync(url);
  } else {
    texture = await new THREE.TextureLoader().loadAsync(url);
    texture.flipY = false;
  }
  texture.magFilter = texture.minFilter = THREE.NearestFilter;
  texture.needsUpdate = true;
  return texture;
}
