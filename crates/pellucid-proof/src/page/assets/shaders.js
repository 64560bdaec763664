// Programs for the graphics processor. Colours come as sRGB, are added up as linear light, and leave as sRGB.

const SURFACE_VERTEX = `#version 300 es
precision highp float;
layout(location = 0) in vec3 position;
layout(location = 1) in vec4 normal;
layout(location = 2) in vec4 color;
uniform vec3 centre, right, up, into;
uniform vec3 scale;   // clip units a mm across, up and into the scene
uniform vec2 shift;   // clip units
uniform vec4 window;  // which part of the clip space is drawn: factor, offset
uniform float shaded;
uniform vec3 white;   // linear light that the print's white stands for
out vec3 light;
flat out highp uint vertex;
vec3 linear(vec3 c) { return mix(c / 12.92, pow((c + 0.055) / 1.055, vec3(2.4)), step(0.04045, c)); }
void main() {
  vec3 p = position - centre;
  vec2 place = vec2(dot(p, right), dot(p, up)) * scale.xy + shift;
  gl_Position = vec4(place * window.xy + window.zw, dot(p, into) * scale.z, 1.0);
  vec3 n = normalize(normal.xyz + 1e-4);
  float lamp = dot(n, normalize(-into + 0.6 * up - 0.4 * right));
  light = white * linear(color.rgb) * mix(1.0, 0.25 + 0.75 * max(0.5 + 0.5 * lamp, 0.0), shaded);
  vertex = uint(gl_VertexID);
}`;

const SURFACE_FRAGMENT = `#version 300 es
precision highp float;
in vec3 light;
out vec4 shown;
void main() { shown = vec4(light, 1.0); }`;

// The number of the vertex, and 1, in bytes.
const PICK_FRAGMENT = `#version 300 es
precision highp float;
flat in highp uint vertex;
out vec4 shown;
void main() {
  uvec4 bytes = uvec4(vertex, vertex >> 8, vertex >> 16, 255u) & 255u;
  shown = vec4(bytes) / 255.0;
}`;

const FULL_VERTEX = `#version 300 es
out vec2 place;
void main() {
  place = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 2.0;
  gl_Position = vec4(place * 2.0 - 1.0, 0.0, 1.0);
}`;

// A Gaussian along one axis, cut at three deviations.
const BLUR_FRAGMENT = `#version 300 es
precision highp float;
in vec2 place;
uniform sampler2D picture;
uniform vec2 deviation; // texture units
out vec4 shown;
void main() {
  vec4 sum = vec4(0.0);
  float weights = 0.0;
  for (int i = -24; i <= 24; i++) {
    float t = float(i) / 8.0, weight = exp(-0.5 * t * t);
    sum += weight * texture(picture, place + t * deviation);
    weights += weight;
  }
  shown = sum / weights;
}`;

const OVER_FRAGMENT = `#version 300 es
precision highp float;
in vec2 place;
uniform sampler2D picture;
uniform vec3 background;
out vec4 shown;
vec3 encoded(vec3 c) { return mix(12.92 * c, 1.055 * pow(max(c, 0.0), vec3(1.0 / 2.4)) - 0.055, step(0.0031308, c)); }
void main() {
  vec4 over = texture(picture, place);
  shown = vec4(encoded(over.rgb + (1.0 - over.a) * background), 1.0);
}`;

function programOf(gl, vertex, fragment) {
  const program = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program) || "no program");
  const uniforms = {};
  for (let i = 0; i < gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS); i++) {
    const { name } = gl.getActiveUniform(program, i);
    uniforms[name] = gl.getUniformLocation(program, name);
  }
  return { program, uniforms };
}
