/* Views in the page: opened in place of a still picture, a few at a time, and closed again. */
(function (shellbench) {
  "use strict";

  const MOST_ALIVE = 4; // browsers allow about 16 WebGL contexts; each takes memory
  const { element, controls, words, pressedKey } = shellbench.controls;
  const NARROW = 520; // px: the bar of colours goes below
  const CONFIG = { displayModeBar: false, responsive: true, scrollZoom: false };
  const alive = new Map(); // by case, the longest unused first

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

  /* Plotly is kept compressed, once, beside the pages, and is let in by its hash. */
  let library = null;
  function plotly() {
    library = library || unpackedLibrary();
    return library;
  }

  function loaded(file) {
    return new Promise((resolve, reject) => {
      const script = element("script", { src: file });
      script.addEventListener("load", resolve);
      script.addEventListener("error", () => reject(new Error(`${file}, which belongs beside this page, is not there`)));
      document.head.append(script);
    });
  }

  async function unpackedLibrary() {
    await loaded(document.body.dataset.library);
    const bytes = await shellbench.field.unzipped(shellbench.library);
    const script = document.createElement("script");
    script.textContent = new TextDecoder().decode(bytes);
    document.head.append(script);
    if (!window.Plotly) {
      throw new Error("the library that draws in three dimensions could not be started");
    }
    return window.Plotly;
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
      return window.Plotly.react(view.plot, shellbench.plot.traces(view.field, view.choice, view.palettes, view.narrow), view.layout, CONFIG);
    });
    return view.drawn;
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
      first: 0, second: null, colour: kept.along ? "picture" : "magnitude", scale: kept.scale, mark: field.answers[0].last, wire: true,
    };
    const view = { figure, field, choice, inputs: {}, palettes: json("palettes"), draw: () => draw(view) };
    view.plot = element("div", {
      class: "plot", tabindex: 0, role: "application",
      "aria-label": `${kept.title}: deformed shell. Arrow keys turn it, plus and minus come nearer and go farther.`,
    });
    view.said = element("p", { class: "said", "aria-live": "polite" });
    view.panel = element("div", { class: "view" }, view.plot, element("div", {}, controls(view), view.said));
    view.plot.addEventListener("keydown", (event) => pressedKey(view, event));
    figure.querySelector("img").after(view.panel);
    figure.classList.add("open");
    view.narrow = view.plot.clientWidth < NARROW;
    view.layout = shellbench.plot.layout(field, view.narrow);
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

  shellbench.views = { alive, open, close };
  document.addEventListener("DOMContentLoaded", prepare);
})((window.shellbench = window.shellbench || {}));
