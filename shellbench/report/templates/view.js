/* Views in the page: opened in place of a still picture, with controls that hands, keys and ears can use. */
(function (shellbench) {
  "use strict";

  const MOST_ALIVE = 4; // browsers allow about 16 WebGL contexts; each takes memory
  const TURN = Math.PI / 18; // radians a key
  const NEARER = 1.15; // a key
  const SLIDER = 200; // steps of the displacement's factor
  const PACE = 220; // ms a state when played
  const KEYS = {
    ArrowLeft: { around: -TURN }, ArrowRight: { around: TURN }, ArrowUp: { over: TURN }, ArrowDown: { over: -TURN },
    "+": { nearer: NEARER }, "=": { nearer: NEARER }, "-": { nearer: 1 / NEARER },
  };
  const BUTTONS = [
    ["←", "Turn left", KEYS.ArrowLeft], ["→", "Turn right", KEYS.ArrowRight], ["↑", "Look from higher", KEYS.ArrowUp],
    ["↓", "Look from lower", KEYS.ArrowDown], ["+", "Nearer", KEYS["+"]], ["−", "Farther", KEYS["-"]],
  ];
  const alive = new Map(); // by case, the longest unused first

  function element(tag, attributes, ...children) {
    const made = document.createElement(tag);
    Object.entries(attributes || {}).forEach(([name, value]) => made.setAttribute(name, value));
    made.append(...children);
    return made;
  }

  function json(id) {
    return JSON.parse(document.getElementById(id).textContent);
  }

  function hasWebGL() {
    const context = document.createElement("canvas").getContext("webgl");
    if (context) {
      context.getExtension("WEBGL_lose_context")?.loseContext();
    }
    return Boolean(context);
  }

  /* Plotly is kept compressed, once, and is let in by its hash. */
  let library = null;
  function plotly() {
    library = library || unpackedLibrary();
    return library;
  }

  async function unpackedLibrary() {
    const bytes = await shellbench.field.unzipped(document.getElementById("plotly").textContent.trim());
    const script = document.createElement("script");
    script.textContent = new TextDecoder().decode(bytes);
    document.head.append(script);
    if (!window.Plotly) {
      throw new Error("the library that draws in three dimensions could not be started");
    }
    return window.Plotly;
  }

  function choices(field) {
    const one = field.answers.map((answer, first) => ({ words: answer.label, first, second: null }));
    const two = field.answers.flatMap((a, first) =>
      field.answers
        .map((b, second) => ({ words: `${a.label} − ${b.label}`, first, second }))
        .filter(({ second }) => second > first),
    );
    return [...one, ...two.map((pair) => ({ ...pair, words: `difference: ${pair.words}` }))];
  }

  const COLOURS = { magnitude: "magnitude", x: "x component", y: "y component", z: "z component" };

  const RAISED = "⁰¹²³⁴⁵⁶⁷⁸⁹";
  const [SMALL, GREAT] = [1e-3, 1e7]; // numbers between are said without a power of ten

  function number(value) {
    const size = Math.abs(value);
    if (size && (size < SMALL || size >= GREAT)) {
      const [digits, exponent] = value.toExponential(2).split("e");
      return `${digits} × 10${superscript(exponent)}`.replace("-", "−");
    }
    return String(Number(value.toPrecision(3))).replace("-", "−");
  }

  function superscript(exponent) {
    const digits = [...String(Math.abs(Number(exponent)))].map((digit) => RAISED[Number(digit)]).join("");
    return (exponent.startsWith("-") ? "⁻" : "") + digits;
  }

  function plain(title) {
    return title.replace(/<sub>(.)<\/sub>/, "_$1");
  }

  /* What is seen, in one sentence. */
  function words(view) {
    const { field, choice } = view;
    const mark = field.kept.marks[choice.mark];
    const values = shellbench.field.coloured(field, choice, choice.mark);
    const title = shellbench.plot.colourTitle(field, choice);
    const shown = choices(field).find((one) => one.first === choice.first && one.second === choice.second).words;
    const parts = [shown, ...(mark ? [mark] : []), `displacement × ${number(choice.scale)}`];
    if (!values) {
      return `${parts.join(", ")}: no such state was kept.`;
    }
    const [low, high] = shellbench.field.extremes(values);
    return `${parts.join(", ")}, coloured by ${plain(title)} from ${number(low)} to ${number(high)}.`;
  }

  function labelled(text, input, ...more) {
    return element("label", {}, element("span", {}, text), input, ...more);
  }

  function select(options, chosen, changed) {
    const input = element("select");
    options.forEach(([value, text]) => input.append(new Option(text, value, false, value === chosen)));
    input.addEventListener("change", () => changed(input.value));
    return input;
  }

  function slider(attributes, changed) {
    const input = element("input", { type: "range", ...attributes });
    input.addEventListener("input", () => changed(Number(input.value)));
    return input;
  }

  function button(text, label, pressed) {
    const made = element("button", { type: "button", "aria-label": label, title: label }, text);
    made.addEventListener("click", pressed);
    return made;
  }

  function colourSelect(view) {
    const dense = shellbench.field.hasDensity(view.field, view.choice);
    const names = Object.entries({ ...COLOURS, ...(dense ? { density: "strain energy density" } : {}) });
    if (!dense && view.choice.colour === "density") {
      view.choice.colour = "magnitude";
    }
    const input = select(names, view.choice.colour, (colour) => changeColour(view, colour));
    input.name = "colour";
    return input;
  }

  function changeColour(view, colour) {
    view.choice.colour = colour;
    if (colour === "density") {
      setMark(view, view.field.answers[view.choice.first].last);
    }
    draw(view);
  }

  function changeShown(view, chosen) {
    const wasOne = view.choice.second === null;
    Object.assign(view.choice, { first: chosen.first, second: chosen.second });
    if (wasOne && chosen.second !== null) {
      view.choice.colour = "magnitude"; // how far apart they are, first of all
    }
    const fresh = colourSelect(view);
    view.inputs.colour.replaceWith(fresh);
    view.inputs.colour = fresh;
    draw(view);
  }

  function setMark(view, mark) {
    view.choice.mark = mark;
    if (view.inputs.mark) {
      view.inputs.mark.value = mark;
      view.inputs.markWords.textContent = view.field.kept.marks[mark];
    }
  }

  function changeMark(view, mark) {
    setMark(view, mark);
    if (view.choice.colour === "density" && mark !== view.field.answers[view.choice.first].last) {
      view.choice.colour = "magnitude"; // its density was kept for the last state only
      view.inputs.colour.value = "magnitude";
    }
    draw(view);
  }

  function play(view, pressed) {
    if (view.timer) {
      clearInterval(view.timer);
      view.timer = null;
    } else {
      view.timer = setInterval(() => changeMark(view, (view.choice.mark + 1) % view.field.kept.marks.length), PACE);
    }
    pressed.textContent = view.timer ? "Stop" : "Play";
    pressed.setAttribute("aria-label", view.timer ? "Stop" : "Play all states");
  }

  function controls(view) {
    const { field, choice } = view;
    const options = choices(field);
    const shown = select(options.map((one, i) => [String(i), one.words]), "0", (i) => changeShown(view, options[i]));
    shown.name = "shown";
    view.inputs.colour = colourSelect(view);
    const step = field.kept.largest_scale / SLIDER;
    const factor = element("output", {}, number(choice.scale));
    const scale = slider({ name: "scale", min: 0, max: field.kept.largest_scale, step, value: choice.scale }, (value) => {
      choice.scale = value;
      factor.textContent = number(value);
      draw(view);
    });
    const wire = element("input", { type: "checkbox", name: "wire" });
    wire.checked = choice.wire;
    wire.addEventListener("change", () => {
      choice.wire = wire.checked;
      draw(view);
    });
    const turns = BUTTONS.map(([text, label, by]) => button(text, label, () => turn(view, by)));
    const home = button("Reset", "Back to the first view", () => look(view, shellbench.plot.firstCamera(field)));
    return element(
      "div", { class: "controls" },
      labelled("Show", shown), labelled("Colour by", view.inputs.colour), labelled("Displacement ×", scale, factor),
      ...states(view), labelled("Reference surface", wire),
      element("div", { class: "turn", role: "group", "aria-label": "Turn" }, ...turns, home),
    );
  }

  function states(view) {
    const { marks } = view.field.kept;
    if (marks.length < 2) {
      return [];
    }
    const value = view.choice.mark;
    const said = element("output", {}, marks[value]);
    const mark = slider({ name: "mark", min: 0, max: marks.length - 1, step: 1, value }, (at) => changeMark(view, at));
    Object.assign(view.inputs, { mark, markWords: said });
    const player = button("Play", "Play all states", () => play(view, player));
    return [labelled("State", mark, said), player];
  }

  function turn(view, by) {
    const now = view.plot._fullLayout.scene._scene.getCamera();
    look(view, shellbench.plot.turned(now.eye, by));
  }

  function look(view, camera) {
    view.layout.scene.camera = camera;
    return window.Plotly.relayout(view.plot, { "scene.camera": camera });
  }

  /* Drawn at most once a frame, with whatever was chosen last. */
  function draw(view) {
    view.said.textContent = words(view);
    if (view.waiting) {
      return view.drawn;
    }
    view.waiting = true;
    view.drawn = new Promise((resolve) => requestAnimationFrame(resolve)).then(() => {
      view.waiting = false;
      if (alive.get(view.field.kept.case) !== view) {
        return null;
      }
      return window.Plotly.react(view.plot, shellbench.plot.traces(view.field, view.choice, view.palettes), view.layout, {
        displayModeBar: false, responsive: true, scrollZoom: false,
      });
    });
    return view.drawn;
  }

  function pressedKey(view, event) {
    const by = KEYS[event.key];
    if (by && !event.ctrlKey && !event.metaKey && !event.altKey) {
      event.preventDefault();
      turn(view, by);
    }
  }

  async function open(figure) {
    const name = figure.dataset.case;
    if (alive.has(name)) {
      return alive.get(name);
    }
    const field = await shellbench.field.unpacked(json(`view-${name}`));
    await plotly();
    const { kept } = field;
    const choice = {
      first: 0, second: null, colour: kept.component, scale: kept.scale, mark: field.answers[0].last, wire: true,
    };
    const view = { figure, field, choice, inputs: {}, palettes: json("palettes"), layout: shellbench.plot.layout(field) };
    view.plot = element("div", {
      class: "plot", tabindex: 0, role: "application",
      "aria-label": `${kept.title}: deformed shell. Arrow keys turn it, plus and minus come nearer and go farther.`,
    });
    view.said = element("p", { class: "said", "aria-live": "polite" });
    view.panel = element("div", { class: "view" }, view.plot, element("div", {}, controls(view), view.said));
    view.plot.addEventListener("keydown", (event) => pressedKey(view, event));
    figure.querySelector("img").after(view.panel);
    figure.classList.add("open");
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
    opener(view.figure).textContent = OPEN;
  }

  const OPEN = "Turn it in 3-D";
  const CLOSE = "Back to the picture";

  function opener(figure) {
    return figure.querySelector("button.opener");
  }

  async function toggle(figure) {
    const view = alive.get(figure.dataset.case);
    if (view) {
      close(view);
      return;
    }
    const pressed = opener(figure);
    pressed.disabled = true;
    pressed.textContent = "One moment…";
    try {
      await open(figure);
      pressed.textContent = CLOSE;
    } catch (error) {
      pressed.replaceWith(element("p", { class: "said" }, `This browser can't show it in three dimensions: ${error.message}.`));
    }
    pressed.disabled = false;
    pressed.focus();
  }

  function lacking() {
    if (typeof DecompressionStream === "undefined") {
      return "This browser is too old for the view in three dimensions (it has no DecompressionStream); the picture stays.";
    }
    return hasWebGL() ? "" : "This browser has no WebGL, so the picture can't be turned.";
  }

  function prepare() {
    const figures = [...document.querySelectorAll("figure[data-case]")];
    const reason = figures.length ? lacking() : "";
    figures.forEach((figure) => {
      if (reason) {
        figure.append(element("p", { class: "said" }, reason));
        return;
      }
      const pressed = element("button", { type: "button", class: "opener" }, OPEN);
      pressed.addEventListener("click", () => toggle(figure));
      figure.querySelector("img").before(pressed);
    });
  }

  shellbench.views = { alive, open, close, words };
  document.addEventListener("DOMContentLoaded", prepare);
})((window.shellbench = window.shellbench || {}));
