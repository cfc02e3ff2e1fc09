/* Views in three dimensions, opened in place of a still picture, a few at a time, and closed again.

   A view has what its case keeps (`kept`), the arrays unpacked from it, and a choice of what is seen. A control changes
   the choice and asks for a drawing; Plotly draws, and turns by mouse. See view.py for what is kept and how. */
(function (shellbench) {
  "use strict";

  const AXES = ["x", "y", "z"];
  const UP = { x: [1, 2, 0], y: [2, 0, 1], z: [0, 1, 2] }; // axes drawn as Plotly's x, y and z, of which z points up
  const BODY = "#ccbda8"; // of obstacles, as in the still pictures
  const NIGHT = window.matchMedia("(prefers-color-scheme: dark)").matches;
  const INK = NIGHT ? "#e6e9ee" : "#1b1f24";
  const PAPER = NIGHT ? "#14181d" : "#fff";
  const COLOURS = { magnitude: "magnitude", x: "x component", y: "y component", z: "z component" };
  const WIRES = 13; // coordinate lines of the reference surface in each direction, as in the still pictures
  const [WIDE, FAR] = [2.0, 2.4]; // of the eye from the middle at first, in sizes of the box; where it is narrow
  const NARROW = 520; // px: the bar of colours goes below
  const [BELOW, BESIDE] = [0.24, 0.17]; // shares of the plot that are the bar's alone
  const FLAT = 0.02; // share of the longest side that every side of the box has at least
  const STEEPEST = 1.565; // radians of elevation: nearly a quarter turn, where the view would roll over
  const MOST_ALIVE = 4; // browsers allow about 16 WebGL contexts; each takes memory
  const SLIDER = 200; // steps of the displacement's factor
  const PACE = 220; // ms a state when played
  const [SMALL, GREAT] = [1e-3, 1e7]; // numbers between are said without a power of ten
  const CONFIG = { displayModeBar: false, responsive: true, scrollZoom: false };
  const [OPEN, CLOSE] = ["Turn it in 3-D", "Back to the picture"];
  const [TURN, NEARER] = [Math.PI / 18, 1.15]; // radians a key; a key
  const TURNS = [
    ["ArrowLeft", "←", "Turn left", { around: -TURN }], ["ArrowRight", "→", "Turn right", { around: TURN }],
    ["ArrowUp", "↑", "Look from higher", { over: TURN }], ["ArrowDown", "↓", "Look from lower", { over: -TURN }],
    ["+", "+", "Nearer", { nearer: NEARER }], ["-", "−", "Farther", { nearer: 1 / NEARER }],
    ["Home", "Reset", "Back to the first view", null],
  ];
  const turnButton = ([key, text, label]) =>
    `<button type="button" value="${key}" aria-label="${label}" title="${label}">${text}</button>`;
  const PANEL = `
    <div class="plot" tabindex="0" role="application"></div>
    <div>
      <div class="controls">
        <label><span>Show</span><select name="shown"></select></label>
        <label><span>Colour by</span><select name="colour"></select></label>
        <label><span>Displacement ×</span><input type="range" name="scale" min="0"><output></output></label>
        <label class="state"><span>State</span><input type="range" name="mark" min="0"><output></output></label>
        <button type="button" name="play" class="state"></button>
        <label><span>Reference surface</span><input type="checkbox" name="wire" checked></label>
        <div class="turn" role="group" aria-label="Turn">
          ${TURNS.map(turnButton).join("")}
        </div>
      </div>
      <p class="said" aria-live="polite"></p>
    </div>`;
  const alive = new Map(); // by case, the longest unused first

  function element(tag, attributes, ...children) {
    const made = document.createElement(tag);
    Object.entries(attributes).forEach(([name, value]) => made.setAttribute(name, value));
    made.append(...children);
    return made;
  }

  /* What is kept, unpacked, and what follows from it. */

  async function unzipped(base64) {
    const bytes = Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0));
    return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"))).arrayBuffer();
  }

  async function unpacked(kept) {
    const stored = new Int16Array(await unzipped(kept.data));
    const points = kept.shape[0] * kept.shape[1];
    let place = 0;
    const plane = (step) => {
      const whole = stored.slice(place, (place += points));
      whole.forEach((difference, i) => (whole[i] = i ? whole[i - 1] + difference : difference)); // it wraps around
      return Float64Array.from(whole, (value) => value * step);
    };
    const vector = (step) => AXES.map(() => plane(step));
    const position = vector(kept.position).map((values, k) => values.map((value) => value + kept.centre[k]));
    const inward = kept.along?.inward && vector(kept.along.inward);
    const answers = [];
    kept.answers.forEach(({ label, states, density }) => {
      const moved = states.map((state, mark) => {
        const values = state && vector(state.step);
        return state?.relative ? sum(values, answers[0].states[mark], 1) : values;
      });
      const last = moved.reduce((found, state, mark) => (state ? mark : found), -1);
      answers.push({ label, moved, states: moved, density: density === null ? null : [plane(density)], last });
    });
    return { kept, position, inward, answers, shows: [...answers, ...differences(answers)] };
  }

  /* The difference of each two answers, coloured on the shape of the first. Densities are of the last state only. */
  function differences(answers) {
    return answers.flatMap((a, place) => answers.slice(place + 1).map((b) => ({
      label: `difference: ${a.label} − ${b.label}`,
      moved: a.moved,
      states: a.states.map((state, mark) => state && b.states[mark] && sum(state, b.states[mark], -1)),
      density: a.density && b.density && a.last === b.last ? sum(a.density, b.density, -1) : null,
      last: a.last,
      apart: true,
    })));
  }

  function sum(first, second, factor) {
    return first.map((values, k) => values.map((value, i) => value + factor * second[k][i]));
  }

  function extremes(values) {
    return values.reduce(([low, high], value) => [Math.min(low, value), Math.max(high, value)], [Infinity, -Infinity]);
  }

  /* What is coloured at a mark, point by point; null where there is nothing. */
  function coloured({ kept, inward }, { states, density, last }, colour, mark) {
    const dense = colour === "density";
    const [x, y, z] = (dense ? last === mark && density : states[mark]) || [];
    if (!x || dense) {
      return x || null;
    }
    if (colour === "magnitude") {
      return x.map((_, i) => Math.hypot(x[i], y[i], z[i]));
    }
    if (colour === "picture" && inward) {
      const [a, b, c] = inward;
      return x.map((_, i) => a[i] * x[i] + b[i] * y[i] + c[i] * z[i]);
    }
    const along = colour === "picture" ? kept.along.vector : AXES.map((axis) => Number(axis === colour));
    return x.map((_, i) => along[0] * x[i] + along[1] * y[i] + along[2] * z[i]);
  }

  /* One range of colours for all states, and for all answers unless a difference is shown. */
  function colourRange({ field, choice: { shown, colour }, palettes }) {
    const found = (shown.apart ? [shown] : field.answers).flatMap((one) =>
      field.kept.marks.flatMap((_, mark) => extremes(coloured(field, one, colour, mark) || [])),
    );
    let [cmin, cmax] = extremes(found.some(Number.isFinite) ? found.filter(Number.isFinite) : [0]);
    const diverging = cmin < 0 && Math.min(-cmin, cmax) > palettes.both_signs * Math.max(-cmin, cmax);
    if (diverging) {
      cmax = Math.max(-cmin, cmax);
      cmin = -cmax;
    }
    const use = diverging ? "diverging" : shown.apart ? "difference" : "sequential";
    return { cmin, cmax: cmax > cmin ? cmax : cmin + (Math.abs(cmin) || 1) * 1e-12, colorscale: palettes.maps[use] };
  }

  function colourTitle({ field: { kept }, choice }) {
    const change = choice.shown.apart ? "Δ" : "";
    if (choice.colour === "density") {
      return `${change && "Δ "}energy density (${kept.density_unit})`;
    }
    const symbols = { magnitude: "|%|", picture: kept.along?.symbol };
    const symbol = symbols[choice.colour] || `%<sub>${choice.colour}</sub>`;
    return `${symbol.replace("%", `${change}u`)} (${kept.shape_unit})`;
  }

  /* What Plotly draws: the surface, the wire of the reference surface and held edges; axes, and the camera. */

  function rows(values, shape) {
    return Array.from({ length: shape[0] }, (_, i) => Array.from(values.subarray(i * shape[1], (i + 1) * shape[1])));
  }

  /* Coordinates in Plotly's order, which turns about its z alone. */
  function turnedUp({ kept }, vector) {
    const [x, y, z] = UP[kept.up].map((k) => vector[k]);
    return { x, y, z };
  }

  function surface(view) {
    const { field, choice, narrow } = view;
    const { kept, position } = field;
    const displacement = choice.shown.moved[choice.mark];
    const values = coloured(field, choice.shown, choice.colour, choice.mark);
    const grid = displacement ? sum(position, displacement, choice.scale) : position;
    const title = colourTitle(view);
    const beside = { len: 0.8, title: { text: title, side: "right" } };
    const below = { orientation: "h", len: 0.9, y: 0, yanchor: "bottom", title: { text: title, side: "top" } };
    return {
      type: "surface",
      ...turnedUp(field, grid.map((plane) => rows(plane, kept.shape))),
      surfacecolor: rows(values || new Float64Array(position[0].length), kept.shape),
      ...colourRange(view),
      showscale: Boolean(values),
      opacity: values ? 1 : 0.15,
      colorbar: { exponentformat: "power", thickness: 14, nticks: 7, ...(narrow ? below : beside) },
      lighting: { ambient: 0.9, diffuse: 0.25, specular: 0, roughness: 1, fresnel: 0 },
      contours: Object.fromEntries(AXES.map((axis) => [axis, { highlight: false }])),
      hovertemplate: `%{surfacecolor:.4g}<extra>${title}</extra>`,
    };
  }

  /* Coordinate lines of the reference surface, each given by its axis and place, in one trace with gaps. */
  function wire({ field, choice }, lines, style) {
    const [n1, n2] = field.kept.shape;
    const places = lines.flatMap(([axis, at]) => [
      ...Array.from({ length: axis ? n1 : n2 }, (_, i) => (axis ? i * n2 + at : at * n2 + i)), null,
    ]);
    const line = field.position.map((plane) => places.map((i) => (i === null ? null : plane[i])));
    const look = { type: "scatter3d", mode: "lines", hoverinfo: "skip", showlegend: false };
    return { ...look, ...turnedUp(field, line), line: style, visible: choice.wire };
  }

  /* Obstacles, whose distance is magnified like the displacement. */
  function obstacles({ field, choice }) {
    return field.kept.obstacles.map(({ at, way }) => ({
      type: "surface", showscale: false, hoverinfo: "skip", opacity: 0.6, colorscale: [[0, BODY], [1, BODY]],
      ...turnedUp(field, at.map((plane, k) => plane.map((row, i) => row.map((value, j) => {
        const far = way[k][i][j];
        return far === null ? null : value + choice.scale * far;
      })))),
    }));
  }

  function traces(view) {
    const { shape, held } = view.field.kept;
    const at = (axis, i) => Math.round((i * (shape[axis] - 1)) / (WIRES - 1));
    const lines = [0, 1].flatMap((axis) => Array.from({ length: WIRES }, (_, i) => [axis, at(axis, i)]));
    const edges = held.map(([axis, side]) => [axis, side === "min" ? 0 : shape[axis] - 1]);
    const [light, thick] = [{ color: "#8c959f", width: 1.5 }, { color: INK, width: 5 }];
    return [surface(view), wire(view, lines, light), wire(view, edges, thick), ...obstacles(view)];
  }

  /* The box holds the reference surface and every state at the slider's end: it does not move with the slider. */
  function layout(view) {
    const { kept, position, answers } = view.field;
    const states = answers.flatMap((answer) => answer.states.filter(Boolean));
    const grids = [position, ...states.map((state) => sum(position, state, kept.largest_scale))];
    const sides = AXES.map((_, k) => extremes(grids.flatMap((grid) => extremes(grid[k]))));
    const largest = Math.max(...sides.map(([low, high]) => high - low));
    const spans = sides.map(([low, high]) => Math.max(high - low, FLAT * largest));
    const axes = sides.map(([low, high], k) => {
      const [flat, middle] = [high - low < FLAT * largest, (low + high) / 2];
      return {
        range: [middle - 0.51 * spans[k], middle + 0.51 * spans[k]],
        title: { text: flat ? "" : `${AXES[k]} (${kept.unit})`, font: { size: 11 } },
        showticklabels: !flat, nticks: 5, tickfont: { size: 10 }, showspikes: false, zeroline: false,
        gridcolor: NIGHT ? "#3b434d" : "#e5e8eb", backgroundcolor: PAPER,
      };
    });
    const { x: xaxis, y: yaxis, z: zaxis } = turnedUp(view.field, axes);
    return {
      margin: { l: 0, r: 0, t: 0, b: 0 },
      showlegend: false,
      font: { family: "system-ui, sans-serif", size: 12, color: INK },
      paper_bgcolor: PAPER,
      scene: {
        xaxis, yaxis, zaxis, domain: view.narrow ? { y: [BELOW, 1] } : { x: [0, 1 - BESIDE] }, dragmode: "turntable", camera: firstCamera(view), uirevision: "kept",
        aspectmode: "manual", aspectratio: turnedUp(view.field, spans.map((span) => span / largest)),
      },
    };
  }

  function camera(azimuth, elevation, distance) {
    const held = Math.max(-STEEPEST, Math.min(STEEPEST, elevation));
    const level = distance * Math.cos(held);
    const eye = { x: level * Math.cos(azimuth), y: level * Math.sin(azimuth), z: distance * Math.sin(held) };
    return { eye, up: { x: 0, y: 0, z: 1 }, center: { x: 0, y: 0, z: 0 } };
  }

  function firstCamera({ field, narrow }) {
    return camera(...field.kept.look.map((degrees) => (degrees * Math.PI) / 180), narrow ? FAR : WIDE);
  }

  function look(view, key) {
    const { x, y, z } = view.plot._fullLayout.scene._scene.getCamera().eye;
    const by = TURNS.find(([name]) => name === key)[3];
    const { around = 0, over = 0, nearer = 1 } = by || {};
    const [azimuth, elevation] = [Math.atan2(y, x) + around, Math.atan2(z, Math.hypot(x, y)) + over];
    view.layout.scene.camera = by ? camera(azimuth, elevation, Math.hypot(x, y, z) / nearer) : firstCamera(view);
    return window.Plotly.relayout(view.plot, { "scene.camera": view.layout.scene.camera });
  }

  /* What is seen, in words: for controls, and in one sentence. */

  function number(value) {
    const size = Math.abs(value);
    const plainly = !size || (size >= SMALL && size < GREAT);
    const [digits, power] = plainly ? [Number(value.toPrecision(3))] : value.toExponential(2).split("e");
    const raised = String(Number(power)).replace(/./g, (digit) => "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"["-0123456789".indexOf(digit)]);
    return String(digits).replace("-", "−") + (power ? ` × 10${raised}` : "");
  }

  function plain(title) {
    return title.replace(/<sub>(.)<\/sub>/, "_$1");
  }

  function sentence(view) {
    const { field, choice } = view;
    const values = coloured(field, choice.shown, choice.colour, choice.mark);
    const parts = [choice.shown.label, field.kept.marks[choice.mark], `displacement × ${number(choice.scale)}`];
    const seen = parts.filter(Boolean).join(", ");
    const [low, high] = extremes(values || []).map(number);
    const colours = `, coloured by ${plain(colourTitle(view))} from ${low} to ${high}.`;
    return seen + (values ? colours : ": no such state was kept.");
  }

  /* Controls. */

  const CHANGES = {
    shown({ field, choice }, { value }) {
      const shown = field.shows[value];
      const colour = shown.apart && !choice.shown.apart ? "magnitude" : choice.colour; // how far apart they are
      Object.assign(choice, { shown, colour });
    },
    colour({ choice }, { value }) {
      choice.colour = value;
      choice.mark = value === "density" ? choice.shown.last : choice.mark;
    },
    scale({ choice }, { value }) {
      choice.scale = Number(value);
    },
    mark({ choice }, { value }) {
      choice.mark = Number(value);
      const lacks = choice.colour === "density" && choice.mark !== choice.shown.last;
      choice.colour = lacks ? "magnitude" : choice.colour;
    },
    wire({ choice }, { checked }) {
      choice.wire = checked;
    },
  };

  function change(view, input) {
    CHANGES[input.name]?.(view, input);
    showChoice(view);
    draw(view);
  }

  /* The controls say what is chosen. */
  function showChoice({ field, choice, inputs, timer }) {
    const { along, marks } = field.kept;
    const colours = {
      ...(along ? { picture: `as in the picture (${plain(along.symbol.replace("%", "u"))})` } : {}),
      ...COLOURS,
      ...(choice.shown.density ? { density: "strain energy density" } : {}),
    };
    choice.colour = choice.colour in colours ? choice.colour : "magnitude";
    if (inputs.colour.options.length !== Object.keys(colours).length) {
      inputs.colour.replaceChildren(...Object.entries(colours).map(([value, words]) => new Option(words, value)));
    }
    inputs.colour.value = choice.colour;
    inputs.scale.nextElementSibling.textContent = number(choice.scale);
    if (inputs.mark) {
      Object.assign(inputs.mark, { max: marks.length - 1, value: choice.mark });
      inputs.mark.nextElementSibling.textContent = marks[choice.mark];
      inputs.play.textContent = timer ? "Stop" : "Play";
      inputs.play.setAttribute("aria-label", timer ? "Stop" : "Play all states");
    }
  }

  function play(view) {
    clearInterval(view.timer);
    const next = () => change(view, { name: "mark", value: (view.choice.mark + 1) % view.field.kept.marks.length });
    view.timer = view.timer ? null : setInterval(next, PACE);
    showChoice(view);
  }

  function connect(view) {
    const { panel, field, choice } = view;
    const { kept } = field;
    panel.querySelectorAll(".state").forEach((one) => kept.marks.length > 1 || one.remove());
    view.inputs = Object.fromEntries([...panel.querySelectorAll("[name]")].map((input) => [input.name, input]));
    const { shown, scale } = view.inputs;
    shown.append(...field.shows.map(({ label }, i) => new Option(label, i)));
    Object.assign(scale, { max: kept.largest_scale, step: kept.largest_scale / SLIDER, value: choice.scale });
    panel.addEventListener("input", ({ target }) => change(view, target), true);
    panel.addEventListener("click", ({ target }) => {
      if (target.type === "button") {
        (target.name === "play" ? play : look)(view, target.value);
      }
    });
    const keys = "Arrow keys turn it, plus and minus come nearer and go farther.";
    view.plot.setAttribute("aria-label", `${kept.title}: ${kept.what}. ${keys}`);
    view.plot.addEventListener("keydown", (event) => {
      const key = event.key === "=" ? "+" : event.key;
      const turns = TURNS.some(([name, , , by]) => by && name === key);
      if (turns && !event.ctrlKey && !event.metaKey && !event.altKey) {
        event.preventDefault();
        look(view, key);
      }
    });
    showChoice(view);
  }

  /* Drawn at most once a frame, with whatever was chosen last. */
  function draw(view) {
    view.panel.querySelector(".said").textContent = sentence(view);
    view.drawn = view.waiting ? view.drawn : new Promise(requestAnimationFrame).then(() => {
      view.waiting = false;
      const open = alive.get(view.field.kept.case) === view;
      return open ? window.Plotly.react(view.plot, traces(view), view.layout, CONFIG) : null;
    });
    view.waiting = true;
    return view.drawn;
  }

  /* Opening and closing. Plotly is kept compressed, once, beside the pages, and is let in by its hash. */

  let library = null;
  async function unpackedLibrary() {
    const file = document.body.dataset.library;
    const script = element("script", { src: file });
    await new Promise((resolve, reject) => {
      script.addEventListener("load", resolve);
      const missing = new Error(`${file}, which belongs beside this page, is not there`);
      script.addEventListener("error", () => reject(missing));
      document.head.append(script);
    });
    document.head.append(element("script", {}, new TextDecoder().decode(await unzipped(shellbench.library))));
    if (!window.Plotly) {
      throw new Error("the library that draws in three dimensions could not be started");
    }
  }

  async function open(figure) {
    const name = figure.dataset.case;
    if (alive.has(name)) {
      return alive.get(name);
    }
    const json = (id) => JSON.parse(document.getElementById(id).textContent);
    const field = await unpacked(json(`view-${name}`));
    await (library = library || unpackedLibrary());
    const { along, scale } = field.kept;
    const [colour, mark] = [along ? "picture" : "magnitude", field.answers[0].last];
    const choice = { shown: field.answers[0], colour, scale, mark, wire: true };
    const panel = element("div", { class: "view" });
    const view = { figure, field, choice, panel, palettes: json("palettes"), timer: null };
    view.panel.innerHTML = PANEL;
    view.plot = view.panel.querySelector(".plot");
    connect(view);
    figure.querySelector("img").after(view.panel);
    figure.classList.add("open");
    view.narrow = view.plot.clientWidth < NARROW;
    view.layout = layout(view);
    alive.set(name, view);
    [...alive.values()].slice(0, -MOST_ALIVE).forEach(close);
    await draw(view);
    return view;
  }

  function close(view) {
    clearInterval(view.timer);
    alive.delete(view.field.kept.case);
    const contexts = [...view.plot.querySelectorAll("canvas")].map((canvas) => canvas.getContext("webgl"));
    window.Plotly.purge(view.plot);
    contexts.forEach((context) => context?.getExtension("WEBGL_lose_context")?.loseContext());
    view.panel.remove();
    view.figure.classList.remove("open");
    view.figure.querySelector("button.opener").textContent = OPEN;
  }

  async function toggle(figure, pressed) {
    if (alive.has(figure.dataset.case)) {
      close(alive.get(figure.dataset.case));
      return;
    }
    pressed.disabled = true;
    pressed.textContent = "One moment…";
    try {
      await open(figure);
      pressed.textContent = CLOSE;
    } catch (error) {
      const words = `This browser can't show it in three dimensions: ${error.message}.`;
      pressed.replaceWith(element("p", { class: "said" }, words));
    }
    pressed.disabled = false;
    pressed.focus();
  }

  function lacking() {
    if (typeof DecompressionStream === "undefined") {
      const what = "This browser is too old for the view in three dimensions (it has no DecompressionStream)";
      return `${what}; the picture stays.`;
    }
    const context = document.createElement("canvas").getContext("webgl");
    context?.getExtension("WEBGL_lose_context")?.loseContext();
    return context ? "" : "This browser has no WebGL, so the picture can't be turned.";
  }

  document.addEventListener("DOMContentLoaded", () => {
    const figures = [...document.querySelectorAll("figure[data-case]")];
    const reason = figures.length ? lacking() : "";
    figures.forEach((figure) => {
      const pressed = element("button", { type: "button", class: "opener" }, OPEN);
      pressed.addEventListener("click", () => toggle(figure, pressed));
      if (reason) {
        figure.append(element("p", { class: "said" }, reason));
      } else {
        figure.querySelector("img").before(pressed);
      }
    });
  });

  shellbench.views = { alive, open, close };
})((window.shellbench = window.shellbench || {}));
