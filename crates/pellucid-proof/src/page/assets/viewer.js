// The print in three dimensions: flat colours by parallel rays, one or two fields side by side, blurred as from afar.

// Blur of the eye for each mm of distance, in mm: 0.1 mm at 300 mm.
const EYE_BLUR = 0.1 / 300;
// Where to look from: degrees about the vertical, and above the horizon.
const SIDES = { front: [25, 20], left: [-65, 20], back: [205, 20], right: [115, 20], top: [0, 89], bottom: [0, -89] };
const CLOSEST = 200;
const SAMPLES = 4;

class Viewer {
  constructor(canvas, surface, scaleColors) {
    const gl = canvas.getContext("webgl2", { antialias: false, alpha: false, preserveDrawingBuffer: true });
    if (!gl) throw new Error("this browser has no WebGL 2");
    Object.assign(this, { canvas, gl, surface, scaleColors });
    this.left = surface.fields[0].key;
    this.right = null;
    this.split = 0.5;
    this.distance = 0;
    this.shaded = false;
    this.white = [1, 1, 1]; // linear light that the print's white is shown as
    this.light = null; // what the print is looked at under; null for the first light
    this.background = [0.5, 0.5, 0.5];
    this.marked = null;
    this.drawn = () => {};
    this.measure();
    this.reset();
    this.surfaceProgram = programOf(gl, SURFACE_VERTEX, SURFACE_FRAGMENT);
    this.pickProgram = programOf(gl, SURFACE_VERTEX, PICK_FRAGMENT);
    this.blurProgram = programOf(gl, FULL_VERTEX, BLUR_FRAGMENT);
    this.overProgram = programOf(gl, FULL_VERTEX, OVER_FRAGMENT);
    this.colorBuffers = new Map();
    this.fill();
    this.onePixel = this.target(1, 1, false, gl.RGBA8);
  }

  // The middle of the surface, and the radius of a ball around it.
  measure() {
    const { positions } = this.surface;
    const low = [Infinity, Infinity, Infinity];
    const high = low.map((v) => -v);
    for (let i = 0; i < positions.length; i++) {
      low[i % 3] = Math.min(low[i % 3], positions[i]);
      high[i % 3] = Math.max(high[i % 3], positions[i]);
    }
    this.centre = low.map((v, i) => (v + high[i]) / 2);
    this.half = low.map((v, i) => (high[i] - v) / 2);
    this.radius = Math.hypot(...this.half) || 1;
  }

  reset() {
    this.zoom = 1;
    this.pan = [0, 0];
    this.lookFrom("front");
  }

  lookFrom(side) {
    [this.azimuth, this.elevation] = SIDES[side];
    this.ask();
  }

  // Looks straight at a vertex.
  lookAt(vertex) {
    const n = [0, 1, 2].map((axis) => this.surface.normals[4 * vertex + axis]);
    this.azimuth = (Math.atan2(n[0], -n[1]) * 180) / Math.PI;
    this.elevation = Math.min(Math.max((Math.atan2(n[2], Math.hypot(n[0], n[1])) * 180) / Math.PI, -80), 80);
    this.zoom = Math.max(this.zoom, 1.5);
    const p = this.inView(vertex);
    this.pan = [-p[0], -p[1]];
    this.marked = vertex;
    this.ask();
  }

  // Right, up and into the scene.
  axes() {
    const [a, e] = [this.azimuth, this.elevation].map((degrees) => (degrees * Math.PI) / 180);
    const into = [-Math.sin(a) * Math.cos(e), Math.cos(a) * Math.cos(e), -Math.sin(e)];
    const right = [Math.cos(a), Math.sin(a), 0];
    const up = [
      right[1] * into[2] - right[2] * into[1],
      right[2] * into[0] - right[0] * into[2],
      right[0] * into[1] - right[1] * into[0],
    ];
    return { right, up, into };
  }

  // Where a vertex lies to the right, up and into the scene, in mm from the middle.
  inView(vertex) {
    const p = [0, 1, 2].map((axis) => this.surface.positions[3 * vertex + axis] - this.centre[axis]);
    const { right, up, into } = this.axes();
    return [right, up, into].map((axis) => axis[0] * p[0] + axis[1] * p[1] + axis[2] * p[2]);
  }

  pixelsPerMm() {
    // The whole object fits, from a little above and however it is turned about the vertical.
    const wide = Math.hypot(this.half[0], this.half[1]);
    const elevation = (SIDES.front[1] * Math.PI) / 180;
    const across = 2.1 * wide;
    const upwards = 2.1 * (this.half[2] * Math.cos(elevation) + wide * Math.sin(elevation));
    return this.zoom * Math.min(this.canvas.width / across, this.canvas.height / upwards);
  }

  turn(azimuth, elevation) {
    this.azimuth += azimuth;
    this.elevation = Math.min(Math.max(this.elevation + elevation, -89), 89);
    this.ask();
  }

  // Moves by pixels of the page.
  move(x, y) {
    const mm = this.pixelRatio() / this.pixelsPerMm();
    this.pan = [this.pan[0] + x * mm, this.pan[1] - y * mm];
    this.ask();
  }

  zoomBy(factor) {
    this.zoom = Math.min(Math.max(this.zoom * factor, 0.3), CLOSEST);
    this.ask();
  }

  pixelRatio() {
    return this.canvas.width / Math.max(this.canvas.clientWidth, 1);
  }

  fill() {
    const { gl, surface } = this;
    this.array = gl.createVertexArray();
    gl.bindVertexArray(this.array);
    const buffer = (data, kind = gl.ARRAY_BUFFER) => {
      gl.bindBuffer(kind, gl.createBuffer());
      gl.bufferData(kind, data, gl.STATIC_DRAW);
    };
    buffer(surface.positions);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 0, 0);
    buffer(surface.normals);
    gl.enableVertexAttribArray(1);
    gl.vertexAttribPointer(1, 4, gl.BYTE, true, 0, 0);
    gl.enableVertexAttribArray(2);
    buffer(surface.triangles, gl.ELEMENT_ARRAY_BUFFER);
  }

  // Under the chosen light, which thickness does not depend on.
  field(key) {
    const light = key === "thickness" ? undefined : this.light ?? undefined;
    return this.surface.fields.find((field) => field.key === key && field.under === light);
  }

  // sRGB of a field at a vertex, false colours for quantities.
  colorAt(field, vertex) {
    if (!field.quantity) return field.channels.map((channel) => channel[vertex]);
    const { most, shown } = field.quantity;
    const t = Math.min(((field.channels[0][vertex] / 255) * most) / shown, 1) * (this.scaleColors.length - 1);
    const below = Math.min(Math.floor(t), this.scaleColors.length - 2);
    return this.scaleColors[below].map((v, c) => Math.round(v + (t - below) * (this.scaleColors[below + 1][c] - v)));
  }

  // sRGB as it is shown.
  shownAt(field, vertex) {
    const bytes = this.colorAt(field, vertex);
    return field.quantity ? bytes : bytes.map((byte, c) => byteOf(linearOf(byte) * this.white[c]));
  }

  useColors(key) {
    const { gl } = this;
    const field = this.field(key);
    let buffer = this.colorBuffers.get(field);
    if (!buffer) {
      const bytes = new Uint8Array(4 * this.surface.vertices);
      const table = field.quantity && Array.from({ length: 256 }, (_, v) => this.colorAt({ ...field, channels: [[v]] }, 0));
      for (let i = 0; i < this.surface.vertices; i++) {
        for (let c = 0; c < 3; c++) bytes[4 * i + c] = table ? table[field.channels[0][i]][c] : field.channels[c][i];
      }
      buffer = gl.createBuffer();
      this.colorBuffers.set(field, buffer);
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.bufferData(gl.ARRAY_BUFFER, bytes, gl.STATIC_DRAW);
    }
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.vertexAttribPointer(2, 4, gl.UNSIGNED_BYTE, true, 0, 0);
  }

  // A picture to draw into; with depth it can hold the surface.
  target(width, height, samples, format) {
    const { gl } = this;
    const framebuffer = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, framebuffer);
    const store = (kind, attachment) => {
      const renderbuffer = gl.createRenderbuffer();
      gl.bindRenderbuffer(gl.RENDERBUFFER, renderbuffer);
      gl.renderbufferStorageMultisample(gl.RENDERBUFFER, samples ? SAMPLES : 0, kind, width, height);
      gl.framebufferRenderbuffer(gl.FRAMEBUFFER, attachment, gl.RENDERBUFFER, renderbuffer);
      return renderbuffer;
    };
    const renderbuffers = [store(format, gl.COLOR_ATTACHMENT0), store(gl.DEPTH_COMPONENT24, gl.DEPTH_ATTACHMENT)];
    return { framebuffer, renderbuffers, width, height };
  }

  texture(width, height) {
    const { gl } = this;
    const texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.SRGB8_ALPHA8, width, height);
    for (const [name, value] of [
      [gl.TEXTURE_MIN_FILTER, gl.LINEAR], [gl.TEXTURE_MAG_FILTER, gl.LINEAR],
      [gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE], [gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE],
    ]) gl.texParameteri(gl.TEXTURE_2D, name, value);
    const framebuffer = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, framebuffer);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, texture, 0);
    return { framebuffer, texture, width, height };
  }

  // Pictures as large as the canvas on the page.
  resize() {
    const { gl, canvas } = this;
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    const most = Math.min(gl.getParameter(gl.MAX_RENDERBUFFER_SIZE), 4096);
    const [width, height] = [canvas.clientWidth, canvas.clientHeight].map((v) => Math.min(Math.max(Math.round(v * ratio), 1), most));
    if (this.scene && canvas.width === width && canvas.height === height) return;
    canvas.width = width;
    canvas.height = height;
    for (const old of this.pictures || []) {
      gl.deleteFramebuffer(old.framebuffer);
      gl.deleteTexture(old.texture || null);
      for (const buffer of old.renderbuffers || []) gl.deleteRenderbuffer(buffer);
    }
    this.scene = this.target(width, height, true, gl.SRGB8_ALPHA8);
    this.first = this.texture(width, height);
    this.second = this.texture(width, height);
    this.pictures = [this.scene, this.first, this.second];
  }

  // Draws before the next frame, once.
  ask() {
    if (this.asked) return;
    this.asked = true;
    requestAnimationFrame(() => {
      this.asked = false;
      this.draw();
    });
  }

  draw() {
    this.resize();
    const { gl, canvas } = this;
    const cut = this.right ? Math.round(this.split * canvas.width) : canvas.width;
    this.drawHalf(this.left, 0, cut);
    if (this.right) this.drawHalf(this.right, cut, canvas.width);
    gl.disable(gl.SCISSOR_TEST);
    this.drawn();
  }

  // One field between two columns of the canvas.
  drawHalf(key, from, to) {
    if (to <= from) return;
    const { gl, canvas } = this;
    gl.disable(gl.SCISSOR_TEST);
    this.drawSurface(this.surfaceProgram, this.scene, key, [1, 1, 0, 0]);
    gl.bindFramebuffer(gl.READ_FRAMEBUFFER, this.scene.framebuffer);
    gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, this.first.framebuffer);
    const size = [0, 0, canvas.width, canvas.height];
    gl.blitFramebuffer(...size, ...size, gl.COLOR_BUFFER_BIT, gl.NEAREST);
    const deviation = this.distance * EYE_BLUR * this.pixelsPerMm();
    if (deviation > 0.3) {
      this.filter(this.first, this.second, [deviation / canvas.width, 0]);
      this.filter(this.second, this.first, [0, deviation / canvas.height]);
    }
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.viewport(...size);
    gl.enable(gl.SCISSOR_TEST);
    gl.scissor(from, 0, to - from, canvas.height);
    this.full(this.overProgram, this.first, (uniforms) => gl.uniform3fv(uniforms.background, this.background));
  }

  drawSurface({ program, uniforms }, target, key, window) {
    const { gl, canvas } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, target.framebuffer);
    gl.viewport(0, 0, target.width, target.height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.useProgram(program);
    gl.bindVertexArray(this.array);
    this.useColors(key);
    const scale = this.pixelsPerMm();
    const [sx, sy] = [(2 * scale) / canvas.width, (2 * scale) / canvas.height];
    const { right, up, into } = this.axes();
    gl.uniform3fv(uniforms.centre, this.centre);
    gl.uniform3fv(uniforms.right, right);
    gl.uniform3fv(uniforms.up, up);
    gl.uniform3fv(uniforms.into, into);
    gl.uniform3f(uniforms.scale, sx, sy, 0.9 / this.radius);
    gl.uniform2f(uniforms.shift, this.pan[0] * sx, this.pan[1] * sy);
    gl.uniform4fv(uniforms.window, window);
    gl.uniform1f(uniforms.shaded ?? null, this.shaded ? 1 : 0);
    gl.uniform3fv(uniforms.white ?? null, this.field(key).quantity ? [1, 1, 1] : this.white);
    gl.drawElements(gl.TRIANGLES, this.surface.triangles.length, gl.UNSIGNED_INT, 0);
    gl.disable(gl.DEPTH_TEST);
  }

  full({ program, uniforms }, picture, set) {
    const { gl } = this;
    gl.useProgram(program);
    gl.bindTexture(gl.TEXTURE_2D, picture.texture);
    set(uniforms);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  filter(from, to, deviation) {
    const { gl } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, to.framebuffer);
    this.full(this.blurProgram, from, (uniforms) => gl.uniform2fv(uniforms.deviation, deviation));
  }

  // The vertex seen at a place of the canvas, in pixels of the page; null beside the print.
  pick(x, y) {
    const { gl, canvas } = this;
    const [u, v] = [(2 * x) / canvas.clientWidth - 1, 1 - (2 * y) / canvas.clientHeight];
    const window = [canvas.width, canvas.height, -u * canvas.width, -v * canvas.height];
    gl.disable(gl.SCISSOR_TEST);
    this.drawSurface(this.pickProgram, this.onePixel, this.left, window);
    const bytes = new Uint8Array(4);
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, bytes);
    this.marked = bytes[3] ? bytes[0] + 256 * bytes[1] + 65536 * bytes[2] : null;
    this.ask();
    return this.marked;
  }

  // Where the marked vertex is on the canvas, in pixels of the page.
  placeOfMark() {
    if (this.marked === null) return null;
    const [x, y] = this.inView(this.marked);
    const scale = this.pixelsPerMm() / this.pixelRatio();
    return [this.canvas.clientWidth / 2 + (x + this.pan[0]) * scale, this.canvas.clientHeight / 2 - (y + this.pan[1]) * scale];
  }

  // The vertex with the highest score.
  best(score) {
    let [found, most] = [0, -Infinity];
    for (let i = 0; i < this.surface.vertices; i++) {
      const value = score(i);
      if (value > most) [found, most] = [i, value];
    }
    return found;
  }

  // The vertex nearest to a place in mm.
  nearest(place) {
    const { positions } = this.surface;
    return this.best((i) => -place.reduce((sum, v, axis) => sum + (positions[3 * i + axis] - v) ** 2, 0));
  }

  // Pointers, wheel and keys. `picked` hears of the vertex at a place that was tapped.
  listen(picked) {
    const { canvas } = this;
    const pointers = new Map();
    let moved = 0;
    const spread = () => {
      const [a, b] = [...pointers.values()];
      return { x: (a.x + b.x) / 2, y: (a.y + b.y) / 2, apart: Math.hypot(a.x - b.x, a.y - b.y) || 1 };
    };
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      pointers.set(event.pointerId, { x: event.offsetX, y: event.offsetY });
      if (pointers.size === 1) moved = 0;
    });
    canvas.addEventListener("pointermove", (event) => {
      const last = pointers.get(event.pointerId);
      if (!last) return;
      const before = pointers.size === 2 && spread();
      const [dx, dy] = [event.offsetX - last.x, event.offsetY - last.y];
      moved += Math.hypot(dx, dy);
      pointers.set(event.pointerId, { x: event.offsetX, y: event.offsetY });
      if (before) {
        const after = spread();
        this.zoomBy(after.apart / before.apart);
        this.move(after.x - before.x, after.y - before.y);
      } else if (event.shiftKey || event.buttons === 2) this.move(dx, dy);
      else this.turn(-0.4 * dx, 0.4 * dy);
    });
    const release = (event) => {
      const single = pointers.size === 1;
      if (pointers.delete(event.pointerId) && single && moved < 5 && event.type === "pointerup") picked(this.pick(event.offsetX, event.offsetY));
    };
    canvas.addEventListener("pointerup", release);
    canvas.addEventListener("pointercancel", release);
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.zoomBy(Math.exp(-0.0015 * event.deltaY));
    }, { passive: false });
    canvas.addEventListener("keydown", (event) => {
      const keys = {
        ArrowLeft: () => this.turn(-10, 0), ArrowRight: () => this.turn(10, 0),
        ArrowUp: () => this.turn(0, 10), ArrowDown: () => this.turn(0, -10),
        "+": () => this.zoomBy(1.25), "=": () => this.zoomBy(1.25), "-": () => this.zoomBy(0.8),
        0: () => this.reset(),
        Enter: () => picked(this.pick(canvas.clientWidth / 2, canvas.clientHeight / 2)),
      };
      if (!keys[event.key] || event.ctrlKey || event.metaKey || event.altKey) return;
      event.preventDefault();
      keys[event.key]();
    });
  }
}
