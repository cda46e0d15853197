// The little of WebGL 2 that the pages need, with fewer words.

const HEAD = "#version 300 es\nprecision highp float; precision highp int;\n";

/** A program of two shaders; its uniforms are set by name, in whatever type they have. */
export class Program {
  constructor(gl, vertex, fragment) {
    this.gl = gl;
    this.program = gl.createProgram();
    for (const [type, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(type);
      gl.shaderSource(shader, HEAD + text);
      gl.compileShader(shader);
      gl.attachShader(this.program, shader);
      gl.deleteShader(shader); // goes with the program
    }
    gl.linkProgram(this.program);
    if (!gl.getProgramParameter(this.program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(this.program) || "shader");
    this.uniforms = new Map();
    for (let i = 0; i < gl.getProgramParameter(this.program, gl.ACTIVE_UNIFORMS); i++) {
      const { name, type } = gl.getActiveUniform(this.program, i);
      this.uniforms.set(name.replace("[0]", ""), { type, place: gl.getUniformLocation(this.program, name) });
    }
  }

  /** Numbers and arrays for the uniforms; textures take the units in the order in which they are given. */
  use(values) {
    const { gl } = this;
    let unit = 0;
    gl.useProgram(this.program);
    for (const [name, value] of Object.entries(values)) {
      if (!this.uniforms.has(name)) continue;
      const { type, place } = this.uniforms.get(name);
      if (value instanceof WebGLTexture) {
        gl.activeTexture(gl.TEXTURE0 + unit);
        gl.bindTexture(gl.TEXTURE_2D, value);
        gl.uniform1i(place, unit++);
      } else if (type === gl.INT) gl.uniform1i(place, value);
      else if (type === gl.FLOAT) gl.uniform1f(place, value);
      else if (type === gl.FLOAT_VEC3) gl.uniform3fv(place, value);
      else if (type === gl.FLOAT_VEC4) gl.uniform4fv(place, value);
      else gl.uniformMatrix4fv(place, false, value);
    }
  }
}

/** Deletes a vertex array, and the buffers that it reads. */
export function deleteArray(gl, array) {
  gl.bindVertexArray(array);
  const read = [0, 1, 2, 3, 4].map((place) => gl.getVertexAttrib(place, gl.VERTEX_ATTRIB_ARRAY_BUFFER_BINDING));
  for (const buffer of [...read, gl.getParameter(gl.ELEMENT_ARRAY_BUFFER_BINDING)]) gl.deleteBuffer(buffer);
  gl.deleteVertexArray(array);
}

/** A texture whose texels are read one by one, or by comparison where it holds depths. */
export function texture(gl, format, width, height, data = null) {
  const made = gl.createTexture(), depth = format === gl.DEPTH_COMPONENT24, filter = depth ? gl.LINEAR : gl.NEAREST;
  gl.bindTexture(gl.TEXTURE_2D, made);
  gl.texStorage2D(gl.TEXTURE_2D, 1, format, width, height);
  if (data) gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, width, height, gl.RGBA, gl.FLOAT, data);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, filter);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, filter);
  if (depth) gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_COMPARE_MODE, gl.COMPARE_REF_TO_TEXTURE);
  return made;
}

/** What draws into a texture. */
export function target(gl, attachment, into) {
  const made = gl.createFramebuffer();
  gl.bindFramebuffer(gl.FRAMEBUFFER, made);
  gl.framebufferTexture2D(gl.FRAMEBUFFER, attachment, gl.TEXTURE_2D, into, 0);
  gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  return made;
}

/** A buffer, and the attribute of the bound vertex array that reads it, `size` numbers a vertex. */
export function attribute(gl, place, size, values) {
  const made = gl.createBuffer();
  gl.bindBuffer(gl.ARRAY_BUFFER, made);
  gl.bufferData(gl.ARRAY_BUFFER, values, gl.DYNAMIC_DRAW);
  gl.enableVertexAttribArray(place);
  gl.vertexAttribPointer(place, size, gl.FLOAT, false, 0, 0);
  return made;
}

export function update(gl, buffer, values) {
  gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
  gl.bufferSubData(gl.ARRAY_BUFFER, 0, values);
}

/** Whether the renderer is a program on the CPU. */
export function isSoftware(gl) {
  const info = gl.getExtension("WEBGL_debug_renderer_info");
  const name = gl.getParameter(info ? info.UNMASKED_RENDERER_WEBGL : gl.RENDERER);
  return /swiftshader|llvmpipe|softpipe|software|basic render/i.test(name);
}
