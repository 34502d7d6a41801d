// SPDX-License-Identifier: GPL-3.0-or-later
// The Khronos glTF renderer in its debug modes. It has no object-space maps: such a map is in its surface's textures.
import { GltfState, GltfView, ResourceLoader } from "@khronosgroup/gltf-viewer";

const { clearcoat, generic, mr } = GltfState.DebugOutput;
// The renderer binds the images of an environment even where it does not light with them.
const NO_IMAGE = { index: 0 };
const NO_ENVIRONMENT = {
  textures: [],
  diffuseEnvMap: NO_IMAGE,
  specularEnvMap: NO_IMAGE,
  sheenEnvMap: NO_IMAGE,
  lut: NO_IMAGE,
  sheenLUT: NO_IMAGE,
  sheenELUT: NO_IMAGE,
  mipCount: 1,
  iblIntensityScale: 1,
};

export async function start(canvas) {
  const view = new GltfView(canvas.gl);
  const loader = new ResourceLoader(view, "/npm/@khronosgroup/gltf-viewer/dist/libs/");
  return {
    async load(url, kind) {
      const state = view.createState();
      state.gltf = await loader.loadGltf(url);
      state.environment = NO_ENVIRONMENT;
      state.sceneIndex = state.gltf.scene ?? 0;
      const settings = state.renderingParameters;
      settings.clearColor = [0, 0, 0, 0];
      settings.useIBL = false;
      settings.renderEnvironmentMap = false;
      const shown = (output) => {
        settings.debugOutput = output;
        canvas.bind();
        view.renderFrame(state, canvas.size, canvas.size);
        return canvas.read();
      };
      return {
        render(index) {
          state.cameraIndex = index;
          if (kind !== "object") return shown(generic.WORLDSPACENORMAL);
          const all = shown(clearcoat.CLEARCOAT_FACTOR);
          [mr.ROUGHNESS, mr.METALLIC].forEach((output, i) => {
            const one = shown(output);
            for (let at = 0; at < all.length; at += 4) all[at + 1 + i] = one[at];
          });
          return all;
        },
        free() {},
      };
    },
  };
}
