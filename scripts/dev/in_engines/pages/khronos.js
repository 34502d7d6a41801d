// SPDX-License-Identifier: GPL-3.0-or-later
// The Khronos glTF renderer in its debug modes. It has no object-space maps: such a map is in its surface's textures.
import { GltfState, GltfView, ResourceLoader } from "@khronosgroup/gltf-viewer";

const { clearcoat, generic, mr } = GltfState.DebugOutput;
const OBJECT = [clearcoat.CLEARCOAT_FACTOR, mr.ROUGHNESS, mr.METALLIC];
const SURFACE = [generic.OCCLUSION, mr.ROUGHNESS, mr.METALLIC];
const GAMMA = 2.2;
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

// The debug mode of occlusion shows a variable that the shader has only where it is lit by an environment: this is its value.
const OCCLUSION_SHOWN = "vec3(ao)";
const OCCLUSION = "vec3(texture(u_OcclusionSampler,getOcclusionUV()).r)";

export async function start(canvas) {
  const shaderSource = canvas.gl.shaderSource.bind(canvas.gl);
  canvas.gl.shaderSource = (shader, text) => shaderSource(shader, text.replace(OCCLUSION_SHOWN, OCCLUSION));
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
      const together = (outputs) => {
        const pictures = outputs.map(shown);
        return pictures[0].map((value, at) => (at % 4 < 3 ? pictures[at % 4][at] : value));
      };
      const gltf = state.gltf;
      const parts = gltf.meshes.flatMap((mesh) => mesh.primitives);
      return {
        tangents: () =>
          parts.map(({ attributes: { TANGENT } }) =>
            TANGENT === undefined ? null : gltf.accessors[TANGENT].getDeinterlacedView(gltf),
          ),
        render(index, output) {
          state.cameraIndex = index;
          if (output === "surface") return together(SURFACE);
          if (output === "color") return shown(mr.BASECOLOR).map((value, at) => (at % 4 < 3 ? value ** GAMMA : value));
          return kind === "object" ? together(OBJECT) : shown(generic.WORLDSPACENORMAL);
        },
        free() {},
      };
    },
  };
}
