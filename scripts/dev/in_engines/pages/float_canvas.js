// SPDX-License-Identifier: GPL-3.0-or-later
// A canvas whose drawing buffer holds 32-bit floats. What an engine draws into the canvas goes into a frame buffer of floats.
export class FloatCanvas {
  constructor(size) {
    this.size = size;
    this.canvas = document.createElement("canvas");
    this.canvas.width = this.canvas.height = size;
    document.body.append(this.canvas);
    const gl = (this.gl = this.canvas.getContext("webgl2", { antialias: false, alpha: true, depth: true }));
    if (!gl?.getExtension("EXT_color_buffer_float")) throw new Error("this browser has no float frame buffers");
    const bind = gl.bindFramebuffer.bind(gl);
    this.target = gl.createFramebuffer();
    bind(gl.FRAMEBUFFER, this.target);
    const buffer = (format, attachment) => {
      const made = gl.createRenderbuffer();
      gl.bindRenderbuffer(gl.RENDERBUFFER, made);
      gl.renderbufferStorage(gl.RENDERBUFFER, format, size, size);
      gl.framebufferRenderbuffer(gl.FRAMEBUFFER, attachment, gl.RENDERBUFFER, made);
    };
    buffer(gl.RGBA32F, gl.COLOR_ATTACHMENT0);
    buffer(gl.DEPTH_COMPONENT24, gl.DEPTH_ATTACHMENT);
    const complete = gl.checkFramebufferStatus(gl.FRAMEBUFFER) === gl.FRAMEBUFFER_COMPLETE;
    if (!complete) throw new Error("this browser cannot draw into floats");
    gl.bindFramebuffer = (where, one) => bind(where, one ?? this.target);
    const drawBuffers = gl.drawBuffers.bind(gl);
    gl.drawBuffers = (list) => drawBuffers(list.map((one) => (one === gl.BACK ? gl.COLOR_ATTACHMENT0 : one)));
    // A context of WebGL 2 has no stencil of its own here, and engines ask for none.
    this.bind = () => bind(gl.FRAMEBUFFER, this.target);
  }

  // The pixels as RGBA, bottom row first.
  read() {
    const gl = this.gl;
    this.bind();
    const pixels = new Float32Array(this.size * this.size * 4);
    gl.readPixels(0, 0, this.size, this.size, gl.RGBA, gl.FLOAT, pixels);
    const error = gl.getError();
    if (error) throw new Error(`WebGL error ${error}`);
    return pixels;
  }
}
