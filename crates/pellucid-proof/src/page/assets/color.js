// sRGB bytes and CIELAB under D65.

const XYZ_OF_RGB = [
  [0.4123907993, 0.3575843394, 0.1804807884],
  [0.2126390059, 0.7151686788, 0.0721923154],
  [0.0193308187, 0.1191947798, 0.9505321522],
];
const RGB_OF_XYZ = [
  [3.2409699419, -1.5373831776, -0.4986107603],
  [-0.9692436363, 1.8759675015, 0.0415550574],
  [0.0556300797, -0.2039769589, 1.0569715142],
];
const WHITE = [0.95045593, 1, 1.08905775];

const linearOf = (byte) => (byte <= 10.31475 ? byte / 3294.6 : ((byte / 255 + 0.055) / 1.055) ** 2.4);
const byteOf = (v) => {
  const linear = Math.min(Math.max(v, 0), 1);
  return Math.round(255 * (linear <= 0.0031308 ? 12.92 * linear : 1.055 * linear ** (1 / 2.4) - 0.055));
};
const times = (matrix, v) => matrix.map((row) => row[0] * v[0] + row[1] * v[1] + row[2] * v[2]);

function labOf(bytes) {
  const f = times(XYZ_OF_RGB, bytes.map(linearOf)).map((v, i) => {
    const t = v / WHITE[i];
    return t > 216 / 24389 ? Math.cbrt(t) : ((24389 / 27) * t + 16) / 116;
  });
  return [116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])];
}

function bytesOfLab([l, a, b]) {
  const y = (l + 16) / 116;
  const xyz = [y + a / 500, y, y - b / 200].map((f, i) => WHITE[i] * (f > 6 / 29 ? f ** 3 : (116 * f - 16) / (24389 / 27)));
  return times(RGB_OF_XYZ, xyz).map(byteOf);
}

// Of lightness, chroma and hue as a report has them.
function cssOfMean({ lightness, chroma, hue_deg }) {
  const hue = (hue_deg * Math.PI) / 180;
  return cssOf(bytesOfLab([lightness, chroma * Math.cos(hue), chroma * Math.sin(hue)]));
}

const cssOf = (bytes) => `rgb(${bytes.join(" ")})`;
const hexOf = (bytes) => "#" + bytes.map((v) => v.toString(16).padStart(2, "0")).join("");

// Numbers as text, with a true minus.
const textOf = (value, digits = 0) => {
  const text = value.toFixed(digits);
  return /[1-9]/.test(text) ? text.replace("-", "−") : text.replace("-", "");
};
