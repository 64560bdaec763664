// Joins the page's parts.

const element = (id) => document.getElementById(id);

function make(kind, properties = {}, ...children) {
  const made = Object.assign(document.createElement(kind), properties);
  made.append(...children);
  return made;
}

function trouble(text) {
  element("trouble").textContent = text;
  element("trouble").hidden = false;
}

// Light, dark, or as the system has it.
function themes() {
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const changed = () => {
    document.documentElement.dataset.theme = element("theme").value || (dark.matches ? "dark" : "light");
    document.dispatchEvent(new Event("theme"));
  };
  element("theme").addEventListener("change", changed);
  dark.addEventListener("change", changed);
  changed();
}

function showView(viewer) {
  const { fields } = viewer.surface;
  const buttons = new Map();
  const options = new Map([...element("compare").options].map((option) => [option.value, option]));
  const update = () => {
    for (const [key, button] of buttons) {
      button.setAttribute("aria-pressed", key === viewer.left);
      button.hidden = options.get(key).disabled = !viewer.field(key);
    }
    const [left, right] = [viewer.field(viewer.left), viewer.right && viewer.field(viewer.right)];
    element("left-name").textContent = left.label;
    element("right-name").textContent = right ? right.label : "";
    element("right-name").hidden = element("divider").hidden = !right;
    showLegend(viewer, [left, right].find((field) => field?.quantity));
    viewer.ask();
  };
  const choose = (key) => {
    viewer.left = key;
    update();
  };
  // Each once, whatever lights it is seen under.
  const byKey = new Map(fields.map((field) => [field.key, field]));
  for (const field of byKey.values()) {
    const button = make("button", { type: "button", textContent: field.label, onclick: () => choose(field.key) });
    button.dataset.field = field.key;
    buttons.set(field.key, button);
    element(field.quantity ? "quantities" : "colors").append(button);
    options.set(field.key, make("option", { value: field.key, textContent: field.label }));
    element("compare").append(options.get(field.key));
  }
  element("quantity-set").hidden = !fields.some((field) => field.quantity);
  element("compare").addEventListener("change", (event) => {
    viewer.right = event.target.value || null;
    update();
  });
  for (const side of Object.keys(SIDES)) {
    element("sides").append(make("button", { type: "button", textContent: side, onclick: () => viewer.lookFrom(side) }));
  }
  element("shade").addEventListener("change", (event) => {
    viewer.shaded = event.target.checked;
    viewer.ask();
  });
  const paper = showPaperWhite(viewer);
  showLights(viewer, () => {
    if (!viewer.field(viewer.left)) viewer.left = "refined";
    if (viewer.right && !viewer.field(viewer.right)) viewer.right = element("compare").value = "";
    paper();
    update();
  });
  const distance = () => {
    viewer.distance = Number(element("distance").value);
    element("distance-text").textContent = viewer.distance ? `${viewer.distance} mm` : "close up";
    viewer.ask();
  };
  element("distance").addEventListener("input", distance);
  distance();
  const background = () => {
    const [r, g, b] = getComputedStyle(element("stage")).backgroundColor.match(/[\d.]+/g).map(Number);
    viewer.background = [r, g, b].map(linearOf);
    viewer.ask();
  };
  document.addEventListener("theme", background);
  background();
  slideDivider(viewer);
  viewer.drawn = () => placeMarker(viewer);
  viewer.listen((vertex) => showPick(viewer, vertex));
  new ResizeObserver(() => viewer.ask()).observe(viewer.canvas);
  choose(["refined", "unrefined", fields[0].key].find((key) => viewer.field(key)));
  return choose;
}

// The print's own white beside a perfect one, on request.
function showPaperWhite(viewer) {
  element("paper-line").hidden = !REPORT?.media_white;
  if (!REPORT?.media_white) return () => {};
  const changed = () => {
    const { media_white } = REPORT.lights?.find((light) => light.illuminant === viewer.light) ?? REPORT;
    viewer.white = element("paper").checked ? media_white : [1, 1, 1];
    if (viewer.marked !== null) showPick(viewer, viewer.marked);
    viewer.ask();
  };
  element("paper").checked = (REPORT.record ?? REPORT).settings?.proof_intent === "AbsoluteColorimetric";
  element("paper").addEventListener("change", changed);
  changed();
  return changed;
}

// The lights of a spectral print; the first is the one that it was judged under.
function showLights(viewer, changed) {
  const [first, ...further] = (REPORT?.lights ?? []).map((light) => light.illuminant);
  element("light-line").hidden = !further.length;
  for (const light of [first, ...further]) element("light").append(make("option", { value: light ?? "", textContent: light ?? "" }));
  element("light").addEventListener("change", () => {
    viewer.light = further.includes(element("light").value) ? element("light").value : null;
    changed();
  });
}

function showLegend(viewer, field) {
  element("legend").hidden = !field;
  if (!field) return;
  const canvas = element("scale");
  const context = canvas.getContext("2d");
  for (let x = 0; x < canvas.width; x++) {
    const value = ((x / (canvas.width - 1)) * 255 * field.quantity.shown) / field.quantity.most;
    context.fillStyle = cssOf(viewer.colorAt({ ...field, channels: [[value]] }, 0));
    context.fillRect(x, 0, 1, 1);
  }
  element("scale-low").textContent = "0";
  element("scale-unit").textContent = `${field.label}, ${field.quantity.unit}`;
  element("scale-high").textContent = `${field.quantity.shown} and more`;
}

function slideDivider(viewer) {
  const divider = element("divider");
  const slide = (split) => {
    viewer.split = Math.min(Math.max(split, 0), 1);
    divider.style.left = `${100 * viewer.split}%`;
    divider.setAttribute("aria-valuenow", Math.round(100 * viewer.split));
    viewer.ask();
  };
  divider.addEventListener("pointerdown", (event) => divider.setPointerCapture(event.pointerId));
  divider.addEventListener("pointermove", (event) => {
    if (!divider.hasPointerCapture(event.pointerId)) return;
    const stage = element("stage").getBoundingClientRect();
    slide((event.clientX - stage.left) / stage.width);
  });
  divider.addEventListener("keydown", (event) => {
    const steps = { ArrowLeft: -0.05, ArrowRight: 0.05, Home: -1, End: 1 };
    if (!(event.key in steps)) return;
    event.preventDefault();
    slide(viewer.split + steps[event.key]);
  });
  slide(viewer.split);
}

function placeMarker(viewer) {
  const place = viewer.placeOfMark();
  element("marker").hidden = !place;
  if (place) [element("marker").style.left, element("marker").style.top] = place.map((v) => `${v}px`);
}

// What a place shows in every field.
function showPick(viewer, vertex) {
  const box = element("pick");
  if (vertex === null) {
    box.replaceChildren(make("p", { className: "hint", textContent: "Nothing of the print is there." }));
    return;
  }
  const table = make("table");
  const fields = [...new Set(viewer.surface.fields.map((field) => viewer.field(field.key)))].filter(Boolean);
  for (const field of fields) {
    const bytes = field.quantity ? [field.channels[0][vertex]] : viewer.shownAt(field, vertex);
    const swatch = make("span", { className: "swatch" });
    swatch.style.background = cssOf(viewer.shownAt(field, vertex));
    const row = table.insertRow();
    row.dataset.field = field.key;
    row.append(make("th", { scope: "row" }, swatch, field.label));
    if (field.quantity) {
      const value = (bytes[0] / 255) * field.quantity.most;
      const more = bytes[0] === 255 ? "≥ " : "";
      row.append(make("td", { colSpan: 2, textContent: `${more}${textOf(value, 1)} ${field.quantity.unit}` }));
    } else {
      const lab = labOf(bytes).map((v) => textOf(v));
      row.append(make("td", { textContent: hexOf(bytes) }), make("td", { textContent: `L* ${lab[0]} a* ${lab[1]} b* ${lab[2]}` }));
    }
  }
  const place = [0, 1, 2].map((axis) => textOf(viewer.surface.positions[3 * vertex + axis], 2));
  const at = make("p", { className: "hint", textContent: `at x ${place[0]}, y ${place[1]}, z ${place[2]} mm` });
  box.replaceChildren(table, at);
}

// Buttons of the findings: the right field, and the place where it is worst.
function showFindings(viewer, choose) {
  const valueOf = (key) => {
    const { channels, quantity } = viewer.field(key);
    return (vertex) => (channels[0][vertex] / 255) * quantity.most;
  };
  // A great error at a target about a class's mean colour.
  const classScore = ({ lightness, chroma, hue_deg }) => {
    const hue = (hue_deg * Math.PI) / 180;
    const wanted = [lightness, chroma * Math.cos(hue), chroma * Math.sin(hue)];
    const [target, error] = [viewer.field("target"), valueOf("error")];
    return (vertex) => {
      const lab = labOf(target.channels.map((channel) => channel[vertex]));
      return error(vertex) - 0.5 * Math.hypot(...lab.map((v, i) => v - wanted[i]));
    };
  };
  for (const button of document.querySelectorAll("[data-show]")) {
    const [key, at] = button.dataset.show.split(":");
    if (key === "places") {
      showPlaces(viewer, button, REPORT.mesh.places[at]);
      continue;
    }
    const field = key === "class" ? "error" : key;
    if (!viewer.field(field)) {
      button.remove();
      continue;
    }
    button.addEventListener("click", () => {
      element("light").selectedIndex = 0;
      element("light").dispatchEvent(new Event("change"));
      const value = valueOf(field);
      let score = key === "thickness" ? (vertex) => -value(vertex) : value;
      if (key === "class") score = classScore(REPORT.evaluation.refined.colour_classes[at].target);
      const vertex = viewer.best(score);
      choose(field);
      pointAt(viewer, vertex);
    });
  }
}

function pointAt(viewer, vertex) {
  viewer.lookAt(vertex);
  showPick(viewer, vertex);
  element("stage").scrollIntoView({ block: "center" });
}

// One place of the mesh after the other.
function showPlaces(viewer, button, places) {
  let next = 0;
  const name = () => (button.textContent = places.length > 1 ? `Show me ${next + 1} of ${places.length}` : "Show me");
  name();
  button.addEventListener("click", () => {
    pointAt(viewer, viewer.nearest(places[next]));
    next = (next + 1) % places.length;
    name();
  });
}

function showLayers(index, manifest) {
  const layers = new Layers(element("slice"), element("sheet"), index, manifest);
  const slider = element("layer");
  slider.max = layers.count - 1;
  const show = async (position) => {
    slider.value = position;
    const number = layers.numberOf(position);
    const height = (number * manifest.pitch_mm[2]).toFixed(2);
    element("layer-text").textContent = `layer ${number} of 0 to ${index.layers - 1}, at ${height} mm`;
    slider.setAttribute("aria-valuetext", element("layer-text").textContent);
    await layers.show(position);
  };
  const step = (by) => show(Math.min(Math.max(Number(slider.value) + by, 0), layers.count - 1));
  slider.addEventListener("input", () => show(Number(slider.value)));
  element("layer-down").addEventListener("click", () => step(-1));
  element("layer-up").addEventListener("click", () => step(1));
  element("layer-zoom").addEventListener("change", (event) => {
    layers.zoom = Number(event.target.value);
    layers.fit();
  });
  element("slice").addEventListener("pointermove", (event) => {
    element("layer-material").textContent = layers.materialAt(event.offsetX, event.offsetY);
  });
  new ResizeObserver(() => layers.fit()).observe(element("sheet"));
  element("layer-note").textContent = index.every > 1
    ? `One pixel is one voxel. This page holds one layer in ${index.every}; the print's files have all.`
    : "One pixel is one voxel; these are the images that are printed.";
  return show(Math.floor(layers.count / 3));
}

function saveButtons(manifest) {
  const texts = { manifest, report: REPORT };
  for (const button of document.querySelectorAll("[data-save]")) {
    button.addEventListener("click", () => {
      const text = JSON.stringify(texts[button.dataset.save], null, 2) + "\n";
      const link = make("a", { href: URL.createObjectURL(new Blob([text])), download: button.textContent.replace("Save ", "") });
      link.click();
      URL.revokeObjectURL(link.href);
    });
  }
  element("record").textContent = JSON.stringify(manifest?.settings ?? manifest ?? REPORT.record.settings, null, 2);
}

async function start() {
  themes();
  const contents = jsonOf("contents");
  const manifest = jsonOf("manifest");
  showCharts();
  saveButtons(manifest);
  const layers = contents.slices && showLayers(contents.slices, manifest);
  try {
    const viewer = new Viewer(element("view"), await readSurface(contents.surface), contents.scale);
    showFindings(viewer, showView(viewer));
    document.querySelector("html").viewer = viewer;
  } catch (error) {
    trouble(`The view cannot be drawn: ${error.message}.`);
    document.querySelector(".look").hidden = true;
  }
  await layers;
  document.documentElement.dataset.ready = Math.round(performance.now());
}

start().catch((error) => trouble(`This page cannot be shown: ${error.message}.`));
