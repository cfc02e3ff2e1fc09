/* What a view shows: its numbers unpacked, and what follows from them. No drawing here. */
(function (shellbench) {
  "use strict";

  const AXES = ["x", "y", "z"];

  async function unzipped(base64) {
    const bytes = Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
    return new Response(stream).arrayBuffer();
  }

  /* A reader of one plane after another, undoing the differences; see view_data.py. */
  function planes(buffer, points) {
    const whole = new Int16Array(buffer);
    let place = 0;
    return function plane(step) {
      const values = new Float64Array(points);
      let sum = 0;
      for (let i = 0; i < points; i += 1, place += 1) {
        sum = ((sum + whole[place] + 32768) & 65535) - 32768;
        values[i] = sum * step;
      }
      return values;
    };
  }

  async function unpacked(kept) {
    const plane = planes(await unzipped(kept.data), kept.shape[0] * kept.shape[1]);
    const vector = (step) => AXES.map(() => plane(step));
    const position = vector(kept.position).map((values, k) => values.map((value) => value + kept.centre[k]));
    const answers = [];
    for (const answer of kept.answers) {
      const states = answer.states.map((state, mark) => {
        if (!state) {
          return null;
        }
        const values = vector(state.step);
        return state.relative ? sum(values, answers[0].states[mark], 1) : values;
      });
      const density = answer.density === null ? null : plane(answer.density);
      answers.push({ label: answer.label, states, density, last: lastIndex(states) });
    }
    return { kept, position, answers, centre: kept.centre };
  }

  function sum(first, second, factor) {
    return first.map((values, k) => values.map((value, i) => value + factor * second[k][i]));
  }

  function lastIndex(states) {
    return states.reduce((last, state, i) => (state ? i : last), -1);
  }

  /* Displacement that is coloured: an answer's own, or the difference of two; null where there is none. */
  function shown(field, choice, mark) {
    const first = field.answers[choice.first].states[mark];
    if (choice.second === null || !first) {
      return first;
    }
    const second = field.answers[choice.second].states[mark];
    return second ? sum(first, second, -1) : null;
  }

  function density(field, choice, mark) {
    const answers = [choice.first, choice.second].filter((i) => i !== null).map((i) => field.answers[i]);
    if (answers.some((answer) => !answer.density || answer.last !== mark)) {
      return null;
    }
    const first = answers[0].density;
    return answers.length === 1 ? first : first.map((value, i) => value - answers[1].density[i]);
  }

  function hasDensity(field, choice) {
    return density(field, choice, field.answers[choice.first].last) !== null;
  }

  /* What is coloured at a mark, point by point; null where there is nothing. */
  function coloured(field, choice, mark) {
    if (choice.colour === "density") {
      return density(field, choice, mark);
    }
    const displacement = shown(field, choice, mark);
    if (!displacement) {
      return null;
    }
    if (choice.colour === "magnitude") {
      return displacement[0].map((x, i) => Math.hypot(x, displacement[1][i], displacement[2][i]));
    }
    const along = choice.colour === "picture" ? field.kept.along.vector : AXES.map((axis) => Number(axis === choice.colour));
    return displacement[0].map((_, i) => along.reduce((total, part, k) => total + part * displacement[k][i], 0));
  }

  function extremes(values) {
    return values.reduce(([low, high], value) => [Math.min(low, value), Math.max(high, value)], [Infinity, -Infinity]);
  }

  /* One range of colours for all states, and for all answers unless a difference is shown. */
  function range(field, choice, bothSigns) {
    const answers = choice.second === null ? field.answers.map((_, i) => i) : [choice.first];
    const all = [];
    answers.forEach((first) => {
      field.kept.marks.forEach((_, mark) => {
        const values = coloured(field, { ...choice, first }, mark);
        if (values) {
          all.push(...extremes(values));
        }
      });
    });
    let [low, high] = extremes(all.length ? all : [0]);
    const diverging = low < 0 && Math.min(-low, high) > bothSigns * Math.max(-low, high);
    if (diverging) {
      high = Math.max(-low, high);
      low = -high;
    }
    return { low, high: high > low ? high : low + (Math.abs(low) || 1) * 1e-12, diverging };
  }

  /* Deformed surface: reference position and so many times the first answer's displacement. */
  function deformed(field, choice, mark, scale) {
    const displacement = field.answers[choice.first].states[mark];
    return displacement ? sum(field.position, displacement, scale) : null;
  }

  /* Box around the reference surface and every state at the slider's end: the frame does not move with the slider. */
  function box(field) {
    const grids = [field.position];
    field.answers.forEach((answer) => {
      answer.states.filter(Boolean).forEach((state) => grids.push(sum(field.position, state, field.kept.largest_scale)));
    });
    return AXES.map((_, k) => extremes(grids.flatMap((grid) => extremes(grid[k]))));
  }

  shellbench.field = { unzipped, unpacked, coloured, hasDensity, range, extremes, deformed, box };
})((window.shellbench = window.shellbench || {}));
