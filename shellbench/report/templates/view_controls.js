/* The controls of a view, and what they say: for hands, keys and ears. They change the choice and ask for a drawing. */
(function (shellbench) {
  "use strict";

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

  function element(tag, attributes, ...children) {
    const made = document.createElement(tag);
    Object.entries(attributes || {}).forEach(([name, value]) => made.setAttribute(name, value));
    made.append(...children);
    return made;
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
    const { along } = view.field.kept;
    const names = Object.entries({
      ...(along ? { picture: `as in the picture (${plain(along.symbol.replace("%", "u"))})` } : {}),
      ...COLOURS,
      ...(dense ? { density: "strain energy density" } : {}),
    });
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
    view.draw();
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
    view.draw();
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
    view.draw();
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
      view.draw();
    });
    const wire = element("input", { type: "checkbox", name: "wire" });
    wire.checked = choice.wire;
    wire.addEventListener("change", () => {
      choice.wire = wire.checked;
      view.draw();
    });
    const turns = BUTTONS.map(([text, label, by]) => button(text, label, () => turn(view, by)));
    const home = button("Reset", "Back to the first view", () => look(view, shellbench.plot.firstCamera(field, view.narrow)));
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

  function pressedKey(view, event) {
    const by = KEYS[event.key];
    if (by && !event.ctrlKey && !event.metaKey && !event.altKey) {
      event.preventDefault();
      turn(view, by);
    }
  }

  shellbench.controls = { element, controls, words, pressedKey };
})((window.shellbench = window.shellbench || {}));
