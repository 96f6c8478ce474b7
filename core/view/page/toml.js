// SPDX-License-Identifier: Apache-2.0
// Values of scene files as texts: reading the few forms that have a control of their own, and writing them.

// Numbers, strings, booleans, arrays and inline tables. undefined if the text is something else.
export function parse_value(text) {
  let at = 0;
  const space = () => { while (/\s/.test(text[at] || "")) ++at; };
  const fail = () => { throw new Error("not a value"); };
  const take = character => { space(); if (text[at] !== character) fail(); ++at; };
  const value = () => {
    space();
    const c = text[at];
    if (c === "[") {
      const list = [];
      ++at;
      for (space(); text[at] !== "]"; space()) {
        list.push(value());
        space();
        if (text[at] === ",") ++at;
        else if (text[at] !== "]") fail();
      }
      ++at;
      return list;
    }
    if (c === "{") {
      const table = {};
      ++at;
      for (space(); text[at] !== "}"; space()) {
        const name = /^[\w.-]+/.exec(text.slice(at)) || fail();
        at += name[0].length;
        take("=");
        table[name[0]] = value();
        space();
        if (text[at] === ",") ++at;
        else if (text[at] !== "}") fail();
      }
      ++at;
      return table;
    }
    if (c === '"' || c === "'") {
      const end = c === "'" ? text.indexOf("'", at + 1) : /^"(?:[^"\\]|\\.)*"/.exec(text.slice(at))?.[0].length + at - 1;
      if (!(end > at)) fail();
      const inner = text.slice(at, end + 1);
      at = end + 1;
      return c === "'" ? inner.slice(1, -1) : JSON.parse(inner);
    }
    const word = /^[\w.+-]+/.exec(text.slice(at)) || fail();
    at += word[0].length;
    if (word[0] === "true" || word[0] === "false") return word[0] === "true";
    const number = Number(word[0].replace(/(?<=\d)_(?=\d)/g, ""));
    return Number.isFinite(number) ? number : fail();
  };
  try {
    const result = value();
    space();
    return at === text.length ? result : undefined;
  } catch { return undefined; }
}

export const number_text = (value, digits = 6) => {
  if (!Number.isFinite(value)) return "0";
  const text = String(Number(value.toPrecision(digits)));
  return text.replace("e+", "e");
};
export const list_text = numbers => `[${numbers.map(value => number_text(value)).join(", ")}]`;
export const string_text = text => JSON.stringify(text);

// {knots: [[x, y], ...], interpolation, plain: written without a table} or null.
export function parse_ramp(text) {
  const value = parse_value(text);
  const knots = Array.isArray(value) ? value : value && value.knots;
  const fine = Array.isArray(knots) && knots.length > 0 &&
    knots.every(knot => Array.isArray(knot) && knot.length === 2 && knot.every(number => typeof number === "number"));
  if (!fine) return null;
  return {knots: knots.map(knot => [...knot]), interpolation: (!Array.isArray(value) && value.interpolation) || "linear",
    plain: Array.isArray(value)};
}
export function ramp_text(ramp) {
  const knots = `[${ramp.knots.map(knot => list_text(knot)).join(", ")}]`;
  return ramp.interpolation === "linear" && ramp.plain ? knots : `{ knots = ${knots}, interpolation = "${ramp.interpolation}" }`;
}

// sRGB "#rrggbb" of a linear colour, and back.
const encoded = v => v <= 0.0031308 ? 12.92 * v : 1.055 * v ** (1 / 2.4) - 0.055;
const linear = v => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4;
export const hex_of = color => "#" + color.map(v => Math.round(255 * encoded(Math.min(1, Math.max(0, v)))).toString(16).padStart(2, "0")).join("");
export const color_of = hex => [1, 3, 5].map(i => Number(linear(parseInt(hex.slice(i, i + 2), 16) / 255).toPrecision(4)));
