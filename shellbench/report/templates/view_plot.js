/* A view drawn by Plotly: surface, wire of the reference surface, colours and camera. */
(function (shellbench) {
  "use strict";

  const WIRES = 13; // coordinate lines of the reference surface in each direction, as in the still pictures
  const DISTANCE = { wide: 1.55, narrow: 2.1 }; // of the eye from the middle at first, in sizes of the box
  const UP = { x: [1, 2, 0], y: [2, 0, 1], z: [0, 1, 2] }; // axes drawn as Plotly's x, y and z, of which z points up
  const FLAT = 0.02; // share of the longest side that every side of the box has at least
  const STEEPEST = 1.565; // radians of elevation: nearly a quarter turn, where the view would roll over

  function rows(values, shape) {
    return Array.from({ length: shape[0] }, (_, i) => Array.from(values.subarray(i * shape[1], (i + 1) * shape[1])));
  }

  /* Coordinates in Plotly's order, which turns about its z alone. */
  function drawn(field, vector) {
    return UP[field.kept.up].map((k) => vector[k]);
  }

  function colourTitle(field, choice) {
    const what = choice.second === null ? "u" : "Δu";
    if (choice.colour === "density") {
      return `${choice.second === null ? "energy density" : "Δ energy density"} (${field.kept.density_unit})`;
    }
    const symbols = { magnitude: "|%|", picture: field.kept.along?.symbol };
    const symbol = symbols[choice.colour] || `%<sub>${choice.colour}</sub>`;
    return `${symbol.replace("%", what)} (${field.kept.unit})`;
  }

  function colours(field, choice, palettes) {
    const { low, high, diverging } = shellbench.field.range(field, choice, palettes.both_signs);
    const use = diverging ? "diverging" : choice.second === null ? "sequential" : "difference";
    return { cmin: low, cmax: high, colorscale: palettes.maps[use] };
  }

  function colourBar(narrow) {
    const common = { exponentformat: "power", thickness: 14, nticks: 7 };
    const beside = { ...common, side: "right", len: 0.8 };
    return narrow ? { ...common, side: "top", orientation: "h", len: 0.9, y: 0, yanchor: "bottom" } : beside;
  }

  function surface(field, choice, palettes, narrow) {
    const { side, ...bar } = colourBar(narrow);
    const grid = shellbench.field.deformed(field, choice, choice.mark, choice.scale);
    const values = shellbench.field.coloured(field, choice, choice.mark);
    const [x, y, z] = drawn(field, grid || field.position).map((plane) => rows(plane, field.kept.shape));
    const bare = !grid || !values;
    return {
      type: "surface",
      x,
      y,
      z,
      surfacecolor: rows(values || new Float64Array(field.position[0].length), field.kept.shape),
      ...colours(field, choice, palettes),
      showscale: !bare,
      opacity: bare ? 0.15 : 1,
      colorbar: { ...bar, title: { text: colourTitle(field, choice), side } },
      lighting: { ambient: 0.9, diffuse: 0.25, specular: 0, roughness: 1, fresnel: 0 },
      contours: { x: { highlight: false }, y: { highlight: false }, z: { highlight: false } },
      hovertemplate: `%{surfacecolor:.4g}<extra>${colourTitle(field, choice)}</extra>`,
    };
  }

  function lineThrough(field, indices, line) {
    indices.forEach((i) => field.position.forEach((plane, k) => line[k].push(i < 0 ? null : plane[i])));
  }

  function gridLine(shape, axis, at) {
    const count = shape[1 - axis];
    return Array.from({ length: count }, (_, i) => (axis === 0 ? at * shape[1] + i : i * shape[1] + at));
  }

  function wire(field, lines, style) {
    const line = [[], [], []];
    lines.forEach(([axis, at]) => lineThrough(field, [...gridLine(field.kept.shape, axis, at), -1], line));
    const [x, y, z] = drawn(field, line);
    return { type: "scatter3d", mode: "lines", x, y, z, line: style, hoverinfo: "skip", showlegend: false };
  }

  function reference(field) {
    const lines = [0, 1].flatMap((axis) =>
      Array.from({ length: WIRES }, (_, i) => [axis, Math.round((i * (field.kept.shape[axis] - 1)) / (WIRES - 1))]),
    );
    return wire(field, lines, { color: "#8c959f", width: 1.5 });
  }

  function heldEdges(field) {
    const lines = field.kept.held.map(([axis, side]) => [axis, side === "min" ? 0 : field.kept.shape[axis] - 1]);
    return wire(field, lines, { color: "#1b1f24", width: 5 });
  }

  function traces(field, choice, palettes, narrow) {
    const bare = [reference(field), heldEdges(field)].map((trace) => ({ ...trace, visible: choice.wire }));
    return [surface(field, choice, palettes, narrow), ...bare];
  }

  function axis(field, k, [low, high], span, largest) {
    const flat = high - low < FLAT * largest;
    const middle = (low + high) / 2;
    return {
      range: [middle - 0.51 * span, middle + 0.51 * span],
      title: { text: flat ? "" : `${"xyz"[k]} (${field.kept.unit})`, font: { size: 11 } },
      showticklabels: !flat, nticks: 5, tickfont: { size: 10 }, showspikes: false, zeroline: false,
      gridcolor: "#e5e8eb", backgroundcolor: "#fff",
    };
  }

  function layout(field, narrow) {
    const sizes = shellbench.field.box(field);
    const largest = Math.max(...sizes.map(([low, high]) => high - low));
    const spans = sizes.map(([low, high]) => Math.max(high - low, FLAT * largest));
    const [xaxis, yaxis, zaxis] = UP[field.kept.up].map((k) => axis(field, k, sizes[k], spans[k], largest));
    const [x, y, z] = drawn(field, spans).map((span) => span / largest);
    return {
      margin: { l: 0, r: 0, t: 0, b: 0 },
      showlegend: false,
      font: { family: "system-ui, sans-serif", size: 12, color: "#1b1f24" },
      scene: {
        xaxis, yaxis, zaxis, aspectmode: "manual", aspectratio: { x, y, z }, dragmode: "turntable",
        camera: firstCamera(field, narrow), uirevision: "kept",
      },
    };
  }

  function firstCamera(field, narrow) {
    const [azimuth, elevation] = field.kept.look.map((degrees) => (degrees * Math.PI) / 180);
    return camera({ azimuth, elevation, distance: narrow ? DISTANCE.narrow : DISTANCE.wide });
  }

  function look({ x, y, z }) {
    return { azimuth: Math.atan2(y, x), elevation: Math.atan2(z, Math.hypot(x, y)), distance: Math.hypot(x, y, z) };
  }

  function camera({ azimuth, elevation, distance }) {
    const held = Math.max(-STEEPEST, Math.min(STEEPEST, elevation));
    const level = distance * Math.cos(held);
    return {
      eye: { x: level * Math.cos(azimuth), y: level * Math.sin(azimuth), z: distance * Math.sin(held) },
      up: { x: 0, y: 0, z: 1 },
      center: { x: 0, y: 0, z: 0 },
    };
  }

  function turned(eye, { around = 0, over = 0, nearer = 1 }) {
    const { azimuth, elevation, distance } = look(eye);
    return camera({ azimuth: azimuth + around, elevation: elevation + over, distance: distance / nearer });
  }

  shellbench.plot = { traces, layout, turned, firstCamera, colourTitle };
})((window.shellbench = window.shellbench || {}));
