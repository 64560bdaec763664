// The slices, as they are printed: a colour for each material.

class Layers {
  constructor(canvas, sheet, index, manifest) {
    Object.assign(this, { canvas, sheet, index, manifest });
    this.bytes = bytesOf("slices-data");
    this.zoom = 1;
    this.colors = new Array(256).fill(manifest.background);
    this.names = ["nothing"];
    for (const material of manifest.materials) {
      this.colors[material.label] = material.rgba;
      this.names[material.label] = material.name;
    }
    canvas.width = index.width;
    canvas.height = index.height;
  }

  // Layers that the page holds.
  get count() {
    return this.index.ends.length;
  }

  numberOf(position) {
    return position * this.index.every;
  }

  // Shows the layer at a position in the page's list, as the image has it.
  async show(position) {
    this.wanted = position;
    const start = position ? this.index.ends[position - 1] : 0;
    const labels = await inflate(this.bytes.subarray(start, this.index.ends[position]));
    if (this.wanted !== position) return;
    this.labels = labels;
    const image = new ImageData(this.index.width, this.index.height);
    const words = new Uint32Array(image.data.buffer);
    const palette = new Uint32Array(Uint8Array.from(this.colors.flat()).buffer);
    for (let i = 0; i < labels.length; i++) words[i] = palette[labels[i]];
    this.canvas.getContext("2d").putImageData(image, 0, 0);
    this.canvas.dataset.layer = this.numberOf(position);
    this.fit();
  }

  // Pixels are as wide and high as voxels; the whole layer fits at zoom 1.
  fit() {
    const [x, y] = this.manifest.pitch_mm;
    const [width, height] = [this.index.width * x, this.index.height * y];
    const most = Math.min(window.innerHeight * 0.6, 700);
    const scale = this.zoom * Math.min(this.sheet.clientWidth / width, most / height);
    this.canvas.style.width = `${width * scale}px`;
    this.canvas.style.height = `${height * scale}px`;
  }

  // The material under a place of the canvas, in pixels of the page.
  materialAt(x, y) {
    if (!this.labels) return "";
    const column = Math.floor((x / this.canvas.clientWidth) * this.index.width);
    const row = Math.floor((y / this.canvas.clientHeight) * this.index.height);
    return this.names[this.labels[row * this.index.width + column]] || "";
  }
}
