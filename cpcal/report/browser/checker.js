"use strict";
// Checks certificates of the format cpcal-certificate/6, as docs/certificate-format.md says: plain JavaScript, whole
// numbers of any size, no library. It shares nothing with the checker in Python but that page.
//
//   checkCertificate(bytes, campaign) -> {claims, ...}      throws Refused {line, code, message}
//   readCampaign(bytes)               -> campaign           bytes: Uint8Array

const FORMAT = "cpcal-certificate/6", CAMPAIGN_FORMAT = "cpcal-campaign-exact/1";
const LIMIT = {line: 4194304, unknowns: 1000, constraints: 100000, boxes: 100000, terms: 100000, bits: 4096, work: 40000000};

class Refused extends Error {
  constructor(line, code, message) { super(message); this.line = line; this.code = code; }
}
let line = 0, work = 0;  // where the checker is, and what it has spent
const refuse = (code, message) => { throw new Refused(line, code, message); };
const need = (holds, message, code = "form") => { if (!holds) refuse(code, message); };
function spend(amount) { work += amount; if (work > LIMIT.work) refuse("limit", "the proof takes more work than is spent here"); }

// ---- numbers m 2^e ---------------------------------------------------------------------------------------------
const D = (m, e = 0) => ({m: BigInt(m), e});
const ZERO = D(0), ONE = D(1);
function aligned(a, b) {
  const e = Math.min(a.e, b.e);
  return [a.m << BigInt(a.e - e), b.m << BigInt(b.e - e), e];
}
const add = (a, b) => { const [x, y, e] = aligned(a, b); return {m: x + y, e}; };
const sub = (a, b) => { const [x, y, e] = aligned(a, b); return {m: x - y, e}; };
const mul = (a, b) => ({m: a.m * b.m, e: a.e + b.e});
const neg = a => ({m: -a.m, e: a.e});
const half = a => ({m: a.m, e: a.e - 1});
const cmp = (a, b) => { const [x, y] = aligned(a, b); return x < y ? -1 : x > y ? 1 : 0; };
const min = (a, b) => cmp(a, b) <= 0 ? a : b;

function hexNumber(text) {
  const found = typeof text === "string" && /^(-?)0x([0-9a-f]{1,64})(?:\.([0-9a-f]{1,64}))?p([+-])([0-9]{1,4})$/.exec(text);
  need(found, "a number is no text such as 0x1.8p+1");
  const power = Number(found[4] + found[5]);
  need(Math.abs(power) <= 1100, "a power of two is beyond 1100");
  const digits = BigInt("0x" + found[2] + (found[3] || ""));
  return D(found[1] ? -digits : digits, power - 4 * (found[3] || "").length);
}
function floatNumber(value) {  // a float64, exactly
  const view = new DataView(new ArrayBuffer(8));
  view.setFloat64(0, value);
  const bits = view.getBigUint64(0), exponent = Number((bits >> 52n) & 2047n), fraction = bits & 0xfffffffffffffn;
  const m = exponent ? fraction | 0x10000000000000n : fraction;
  return D(bits >> 63n ? -m : m, Math.max(exponent, 1) - 1075);
}

// ---- JSON: whole numbers of any size, no key twice ----------------------------------------------------------------
function utf8(bytes) {
  let out = "";
  for (let k = 0; k < bytes.length;) {
    const b = bytes[k++];
    const more = b < 0x80 ? 0 : b >= 0xc2 && b < 0xe0 ? 1 : b >= 0xe0 && b < 0xf0 ? 2 : b >= 0xf0 && b < 0xf5 ? 3 : -1;
    need(more >= 0 && k + more <= bytes.length, "is not UTF-8");
    let code = more ? b & (0x3f >> more) : b;
    for (let n = 0; n < more; n++) { need((bytes[k] & 0xc0) === 0x80, "is not UTF-8"); code = code << 6 | bytes[k++] & 0x3f; }
    need(more < 2 || code >= (more === 2 ? 0x800 : 0x10000), "is not UTF-8");
    need(code <= 0x10ffff && (code < 0xd800 || code > 0xdfff), "is not UTF-8");
    out += String.fromCodePoint(code);
  }
  return out;
}
const SPACE = /[ \t\n\r]*/y, TEXT = /"(?:[^"\\\x00-\x1f]|\\(?:["\\\/bfnrt]|u[0-9a-fA-F]{4}))*"/y, INTEGER = /-?(?:0|[1-9][0-9]*)(?![0-9.eE])/y;
// `taken` is given the elements of the top object's member `measurements` one by one, of which no list is kept.
function parseJson(text, taken = null) {
  let at = 0, depth = 0;
  const take = pattern => { pattern.lastIndex = at; const found = pattern.exec(text); if (found) at = pattern.lastIndex; return found && found[0]; };
  const next = sign => { take(SPACE); if (text[at] !== sign) return false; at++; return true; };
  function string() { const found = take(TEXT); need(found !== null, "is no JSON"); return JSON.parse(found); }
  function value(each) {
    take(SPACE);
    need(++depth < 30, "is nested too deep");
    const found = inner(each);
    depth--;
    return found;
  }
  function inner(each) {
    for (const [word, meaning] of [["null", null], ["true", true], ["false", false]])
      if (text.startsWith(word, at)) { at += word.length; return meaning; }
    if (text[at] === "\"") return string();
    if (next("[")) {
      const out = [];
      if (next("]")) return out;
      do { const found = value(null); if (each) each(found); else out.push(found); } while (next(","));
      need(next("]"), "is no JSON");
      return out;
    }
    if (next("{")) {
      const out = new Map();
      if (next("}")) return out;
      do {
        take(SPACE);
        const key = string();
        need(!out.has(key), "a key stands twice");
        need(next(":"), "is no JSON");
        out.set(key, value(depth === 1 && key === "measurements" ? taken : null));
      } while (next(","));
      need(next("}"), "is no JSON");
      return out;
    }
    const number = take(INTEGER);
    need(number !== null && number.replace("-", "").length <= 4300, "is no JSON, or holds a number that is no integer");
    return BigInt(number);
  }
  const found = value(null);
  take(SPACE);
  need(at === text.length, "is no JSON");
  return found;
}

// ---- what fields may hold ---------------------------------------------------------------------------------------
function fields(value, ...keys) {
  need(value instanceof Map, "is no object");
  need(value.size === keys.length && keys.every(key => value.has(key)), "has other keys than " + keys.join(", "));
  return keys.map(key => value.get(key));
}
const list = (value, length = -1) => { need(Array.isArray(value) && (length < 0 || value.length === length), "is no list, or of another length"); return value; };
const integer = (value, lo, hi) => { need(typeof value === "bigint" && value >= BigInt(lo) && value <= BigInt(hi), `an integer is not from ${lo} to ${hi}`); return Number(value); };
const big = (value, hi) => { need(typeof value === "bigint" && value >= 0n && value <= hi, "a weight is out of range"); return value; };
const text = value => { need(typeof value === "string", "is no text"); return value; };
const truth = value => { need(typeof value === "boolean", "is neither true nor false"); return value; };
const orNull = (value, read) => value === null ? null : read(value);
const numbers = (value, length) => list(value, length).map(hexNumber);
function ascending(value, most) {
  const out = list(value).map(v => integer(v, 0, most - 1));
  need(out.every((v, k) => !k || v > out[k - 1]), "is not ascending");
  return out;
}

// ---- polynomials in u and y: {e, t}: a Map from monomials to whole numbers, times 2^e ----------------------------------
// A monomial is a sorted text, one letter a factor: y_0..y_6 come before u_0, u_1, ...
const Y = j => String.fromCharCode(16 + j), U = i => String.fromCharCode(256 + i);
const constant = d => ({e: d.e, t: d.m ? new Map([["", d.m]]) : new Map()});
const line1 = (c, r, letter) => plus(constant(c), {e: r.e, t: r.m ? new Map([[letter, r.m]]) : new Map()});
function plus(a, b) {
  if (a.e > b.e) [a, b] = [b, a];
  const shift = BigInt(b.e - a.e), t = new Map(a.t);
  for (const [key, value] of b.t) {
    const sum = (t.get(key) || 0n) + (value << shift);
    if (sum) t.set(key, sum); else t.delete(key);
  }
  spend(5 + b.t.size / 4);
  need(t.size <= LIMIT.terms, "a polynomial has too many terms", "limit");
  return {e: a.e, t};
}
const scaled = (a, d) => ({e: a.e + d.e, t: d.m ? new Map([...a.t].map(([key, value]) => [key, value * d.m])) : new Map()});
const minus = (a, b) => plus(a, scaled(b, D(-1)));
const twice = a => ({e: a.e + 1, t: a.t});
function merged(a, b) {
  if (!a || !b) return a + b;
  if (a.length === 1 && b.length === 1) return a <= b ? a + b : b + a;
  return [...a + b].sort().join("");
}
function times(a, b) {
  const t = new Map();
  spend(10 + a.t.size * b.t.size);
  for (const [ka, va] of a.t) for (const [kb, vb] of b.t) {
    const key = merged(ka, kb);
    t.set(key, (t.get(key) || 0n) + va * vb);
  }
  need(t.size <= LIMIT.terms, "a polynomial has too many terms", "limit");
  for (const [key, value] of t) if (!value) t.delete(key);
  return {e: a.e + b.e, t};
}
const total = parts => parts.reduce(plus);

// A bound from below: the constant, less what each other term can take away.
function least(poly, signs = "") {
  let sum = 0n;
  for (const [key, value] of poly.t) {
    if (key === "") sum += value;
    else if (!within01(key, signs)) sum -= value < 0n ? -value : value;
    else if (value < 0n) sum += value;
  }
  return D(sum, poly.e);
}
function within01(key, signs) {  // every u, and every y of sign 0, to an even power
  for (let k = 0, run; k < key.length; k += run) {
    for (run = 1; key[k + run] === key[k]; run++);
    const j = key.charCodeAt(k) - 16;
    if (run % 2 && (j > 6 || signs[j] === "0")) return false;
  }
  return true;
}

// ---- the problem --------------------------------------------------------------------------------------------------
const MODELS = {plain: 8, gain: 9, lateral: 9};

class Leg {
  constructor(campaign, header) {
    const [format, digest, leg, model, count, only, lo, hi] = header;
    const n = MODELS[text(model)];
    need(n && Object.hasOwn(MODELS, model), "is no known model");
    Object.assign(this, {model, n, objective: n - 1, lo: numbers(lo, n), hi: numbers(hi, n), sides: ["upper", "lower", "sign", "body", "length"], signs: 7});
    const most = integer(count, 1, 1e9), number = integer(leg, 1, 1e9), chosen = orNull(only, v => ascending(v, most));
    need(chosen === null || chosen.length, "only names no measurement");
    need(campaign !== null && text(digest) === campaign.sha256, "the campaign is another one", "campaign");
    need(most === campaign.rows.length, "the campaign has another number of measurements");
    need(number <= campaign.legs, "the campaign has no such leg");
    need(cmp(this.lo[n - 1], ZERO) >= 0, "eps begins below 0");
    this.about = {leg: number, model, only: chosen};
    Object.assign(this, {campaign, number});
    this.numbers = chosen === null ? campaign.rows.map((_, k) => k) : chosen;
    this.spoken = new Set(this.numbers);
  }
  row(k) {
    const {campaign: {rows, legs}, number} = this, v = rows[k], at = j => floatNumber(v[j]), cut = (from, to) => Array.from(v.subarray(from, to), floatNumber);
    return {P: cut(0, 3), q: cut(3, 7), L: at(6 + number), rho: [...cut(7 + legs, 10 + legs), ...cut(10 + legs, 13 + legs).map(half), at(12 + legs + number)]};
  }
  // factor, body, at_least, at_most as polynomials, for unknowns x and a reading m that are polynomials
  parts(k, x, m) {
    const {P, q, L} = this.row(k), [w0, x0, y0, z0] = q.map(constant), [a1, a2, a3, s1, s2, s3, e] = m;
    const w = minus(w0, total([times(s1, x0), times(s2, y0), times(s3, z0)]));
    const X = plus(plus(x0, times(s1, w0)), minus(times(s2, z0), times(s3, y0)));
    const Yq = plus(plus(y0, times(s2, w0)), minus(times(s3, x0), times(s1, z0)));
    const Z = plus(plus(z0, times(s3, w0)), minus(times(s1, y0), times(s2, x0)));
    const [ww, xx, yy, zz] = [w, X, Yq, Z].map(v => times(v, v));
    const xy = times(X, Yq), xz = times(X, Z), yz = times(Yq, Z), wx = times(w, X), wy = times(w, Yq), wz = times(w, Z);
    const kappa = total([ww, xx, yy, zz]);
    const A = [
      [minus(plus(ww, xx), plus(yy, zz)), twice(minus(xy, wz)), twice(plus(xz, wy))],
      [twice(plus(xy, wz)), minus(plus(ww, yy), plus(xx, zz)), twice(minus(yz, wx))],
      [twice(minus(xz, wy)), twice(plus(yz, wx)), minus(plus(ww, zz), plus(xx, yy))]];
    const place = P.map((c, i) => plus(constant(c), [a1, a2, a3][i])), z = place.map((v, i) => minus(v, x[i])), b = x.slice(3, 6);
    const Ab = A.map(row => total(row.map((v, i) => times(v, b[i]))));
    let square = total([...z, ...b].map(v => times(v, v)));
    if (this.model === "lateral") square = minus(square, x[7]);
    const body = plus(times(kappa, square), twice(total(z.map((v, i) => times(v, Ab[i])))));
    const read = plus(constant(L), e), eps = x[this.n - 1];
    let length = plus(read, x[6]);
    if (this.model === "gain") length = plus(length, times(x[7], read));
    return {kappa, factor: kappa, body, least: minus(length, eps), most: plus(length, eps), root: true};
  }
  lengthRow(k, x, scale = ONE) {  // eps - l - (L - lambda)
    const {L, rho} = this.row(k);
    return minus(minus(x[this.n - 1], x[6]), constant(sub(L, mul(scale, rho[6]))));
  }
  get positive() { return this.model === "plain" || this.model === "lateral"; }
  rho(k) { return this.row(k).rho; }
}

class Stated {
  constructor(header) {
    const [format, about, unknowns, objective, count, lo, hi] = header;
    const names = list(unknowns).map(text), n = names.length;
    need(n >= 1 && new Set(names).size === n, "names of unknowns are missing, or not different");
    need(n <= LIMIT.unknowns, "too many unknowns", "limit");
    const rows = integer(count, 0, Number.MAX_SAFE_INTEGER);
    need(rows <= LIMIT.constraints, "too many constraints", "limit");
    Object.assign(this, {n, objective: orNull(objective, v => integer(v, 0, n - 1)), lo: numbers(lo, n), hi: numbers(hi, n), sides: ["upper", "lower", "sign", "body"], signs: 0});
    this.about = {about: text(about)};
    this.numbers = [...Array(rows).keys()];
    this.spoken = new Set(this.numbers);
    this.rows = [];
  }
  constraint(value) {
    const [name, root, body, least, most] = fields(value, "name", "root", "body", "at_least", "at_most");
    text(name);
    this.rows.push({root: truth(root), body: this.poly(body), least: orNull(least, v => this.poly(v)), most: orNull(most, v => this.poly(v))});
  }
  poly(value) {
    const seen = new Set();
    return list(value).map(term => {
      const [monomial, coefficient] = list(term, 2), ids = list(monomial).map(v => integer(v, 0, this.n - 1)), key = ids.join();
      need(ids.length <= 8 && ids.every((v, k) => !k || v >= ids[k - 1]) && !seen.has(key), "a monomial is not ascending, too long, or there twice");
      seen.add(key);
      return [ids, hexNumber(coefficient)];
    });
  }
  parts(k, x) {
    const {root, body, least, most} = this.rows[k];
    const put = poly => poly === null ? null : poly.reduce((sum, [ids, d]) => plus(sum, ids.reduce((p, i) => times(p, x[i]), constant(d))), constant(ZERO));
    return {factor: constant(ONE), body: put(body), least: put(least), most: put(most), root};
  }
  lengthRow() { return constant(ZERO); }
  get positive() { return false; }
  rho() { return []; }
}

// ---- rows in u -----------------------------------------------------------------------------------------------------
function rowInU(problem, [side, k, signs], box) {
  const x = box.lo.map((lo, i) => line1(half(add(lo, box.hi[i])), half(sub(box.hi[i], lo)), U(i)));
  return withoutReadings(side === "length" ? problem.lengthRow(k, x) : sideOf(problem, side, problem.parts(k, x, readingSet(problem, k, signs)), signs), signs);
}
const readingSet = (problem, k, signs, scale = ONE) => problem.rho(k).map(v => mul(v, scale)).map((rho, j) =>
  signs[j] === "0" ? line1(ZERO, rho, Y(j)) : signs[j] === "+" ? line1(rho, mul(rho, D(-2)), Y(j)) : line1(neg(rho), mul(rho, D(2)), Y(j)));
function sideOf(problem, side, {factor, body, least: low, most: high, root, upper, lower}, signs) {
  if (side === "upper" && upper) return upper();
  if (side === "upper" && high !== null) return root ? minus(body, times(factor, times(high, high))) : minus(body, high);
  if (side === "lower" && low !== null) {
    if (!root) return minus(low, body);
    const row = lower ? lower() : minus(times(factor, times(low, low)), body), deepest = problem.positive ? ZERO : neg(least(low, signs));
    if (cmp(deepest, ZERO) <= 0) return row;
    return minus(row, constant(mul(neg(least(scaled(factor, D(-1)), signs)), mul(deepest, deepest))));
  }
  if (side === "sign" && root && high !== null) return scaled(high, D(-1));
  if (side === "body" && root) return scaled(body, D(-1));
  return constant(ZERO);
}
function withoutReadings(poly, signs) {
  const plain = new Map(), groups = new Map();
  for (const [key, value] of poly.t) {
    const j = key ? key.charCodeAt(0) - 16 : 99;
    if (j > 6) plain.set(key, value);
    else { if (!groups.has(j)) groups.set(j, new Map()); groups.get(j).set(key, value); }
  }
  let row = {e: poly.e, t: plain};
  for (const [j, t] of groups) {
    const whole = {e: poly.e, t};
    if (signs[j] === "0") { row = plus(row, constant(least(whole, signs))); continue; }
    const worst = least({e: poly.e, t: new Map([...t].map(([key, value]) => [key.slice(1), value]))}, signs);
    if (worst.m < 0n) row = plus(row, constant(worst));
  }
  return row;
}

// ---- steps ---------------------------------------------------------------------------------------------------------
function readRow(problem, value) {
  list(value);
  need(value.length === 2 || value.length === 3, "a row is not [side, k] or [side, k, signs]");
  const side = text(value[0]), k = integer(value[1], 0, Number.MAX_SAFE_INTEGER);
  need(problem.sides.includes(side), "is no side of a row");
  need(problem.spoken.has(k), "a row of a measurement that is left out");
  return [side, k, value.length === 3 ? readSigns(problem, value[2]) : "0".repeat(problem.signs)];
}
function readSigns(problem, value) {
  need(new RegExp(`^[-0+]{${problem.signs}}$`).test(text(value)), "signs are not seven of -, 0, +");
  return value;
}
function readWeights(problem, rows, value) {
  const [ofRows, products, tangents, exponents] = fields(value, "rows", "products", "tangents", "exponents"), top = (1n << 60n) - 1n, last = problem.n - 1;
  const sign = v => { need(v === 1n || v === -1n, "is neither 1 nor -1"); return v; };
  return {
    rows: list(ofRows).map(v => { const [n, w] = list(v, 2); return [integer(n, 0, rows.length - 1), big(w, top)]; }),
    products: list(products).map(v => { const [i, j, p, q, w] = list(v, 5); return [integer(i, 0, last), integer(j, 0, last), sign(p), sign(q), big(w, top)]; }),
    tangents: list(tangents).map(v => { const [i, t, w] = list(v, 3); return [integer(i, 0, last), hexNumber(t), big(w, top)]; }),
    exponents: list(exponents, 3).map(v => integer(v, -1000, 999)),
  };
}
function combination(weights, rows) {  // S(u)
  const [e, f, g] = weights.exponents;
  let sum = constant(ZERO);
  for (const [n, w] of weights.rows) if (w) sum = plus(sum, scaled(rows(n), D(w, e)));
  for (const [i, j, p, q, w] of weights.products) if (w) sum = minus(sum, scaled(times(line1(ONE, D(p), U(i)), line1(ONE, D(q), U(j))), D(w, f)));
  for (const [i, t, w] of weights.tangents) if (w) { const away = line1(neg(t), ONE, U(i)); sum = minus(sum, scaled(times(away, away), D(w, g))); }
  return sum;
}

class Proof {
  constructor(problem, claims) {
    Object.assign(this, {problem, claims, open: new Map([[0, {lo: problem.lo, hi: problem.hi}]]), next: 1});
  }
  step(value) {
    need(value instanceof Map, "is no object");
    const kind = ["pass", "exclude", "split"].find(key => value.has(key));
    need(kind, "is no step");
    spend(this.problem.n);
    this[kind](value);
  }
  box(value) {
    const name = integer(value, 0, Number.MAX_SAFE_INTEGER);
    need(this.open.has(name), "names a box that is not open");
    return name;
  }
  capped(name, value) {  // the box below the cap; null where nothing is left
    const {objective: t, lo, hi} = this.problem, box = this.open.get(name);
    if (t === null) { need(value === null, "has a cap without an objective"); return box; }
    const cap = hexNumber(value);
    need(cmp(cap, lo[t]) >= 0 && cmp(cap, hi[t]) <= 0 && cmp(cap, this.claims.cap) >= 0, "a cap is out of its range");
    if (cmp(box.lo[t], cap) > 0) return null;
    return {lo: box.lo, hi: box.hi.map((v, i) => i === t ? min(v, cap) : v)};
  }
  rowsOn(rows, box) {
    const kept = new Map();
    return n => { if (!kept.has(n)) kept.set(n, rowInU(this.problem, rows[n], box)); return kept.get(n); };
  }
  pass(value) {
    const [name_, cap, rows_, bounds_] = fields(value, "pass", "cap", "rows", "bounds"), name = this.box(name_), box = this.capped(name, cap);
    const rows = list(rows_).map(row => readRow(this.problem, row));
    const bounds = list(bounds_).map(v => {
      const [i, side, number, weights] = list(v, 4);
      need(side === "lo" || side === "hi", "is neither lo nor hi");
      return [integer(i, 0, this.problem.n - 1), side, hexNumber(number), readWeights(this.problem, rows, weights)];
    });
    if (box === null) { this.open.delete(name); return; }
    const on = this.rowsOn(rows, box), lo = [...box.lo], hi = [...box.hi];
    for (const [i, side, number, weights] of bounds) {
      const down = side === "lo", one = down ? ONE : neg(ONE);
      const bound = least(plus(combination(weights, on), line1(ZERO, one, U(i))));
      const c = half(add(box.lo[i], box.hi[i])), reach = mul(half(sub(box.hi[i], box.lo[i])), bound), proved = down ? add(c, reach) : sub(c, reach);
      need(down ? cmp(proved, number) >= 0 : cmp(proved, number) <= 0, `the weights prove less than the bound on unknown ${i}`, "proof");
      if (down && cmp(number, lo[i]) > 0) lo[i] = number;
      if (!down && cmp(number, hi[i]) < 0) hi[i] = number;
    }
    if (lo.some((v, i) => cmp(v, hi[i]) > 0)) this.open.delete(name); else this.open.set(name, {lo, hi});
  }
  exclude(value) {
    const [name_, cap, rows_, weights_] = fields(value, "exclude", "cap", "rows", "weights"), name = this.box(name_), box = this.capped(name, cap);
    const rows = list(rows_).map(row => readRow(this.problem, row)), weights = readWeights(this.problem, rows, weights_);
    if (box !== null) need(least(combination(weights, this.rowsOn(rows, box))).m > 0n, "the weights do not exclude the box", "proof");
    this.open.delete(name);
  }
  split(value) {
    const [name_, unknown, at_, into] = fields(value, "split", "unknown", "at", "into"), name = this.box(name_), i = integer(unknown, 0, this.problem.n - 1), at = hexNumber(at_), box = this.open.get(name);
    const names = list(into, 2).map(v => integer(v, 0, Number.MAX_SAFE_INTEGER));
    need(names[0] === this.next && names[1] === this.next + 1, "the parts have other names than the next two numbers");
    need(cmp(at, box.lo[i]) >= 0 && cmp(at, box.hi[i]) <= 0, "a split is not in the box");
    const cut = (ends, end) => ends.map((v, j) => j === i ? at : v);
    this.open.delete(name);
    this.open.set(names[0], {lo: box.lo, hi: cut(box.hi)});
    this.open.set(names[1], {lo: cut(box.lo), hi: box.hi});
    this.next += 2;
    need(this.open.size <= LIMIT.boxes, "too many open boxes", "limit");
  }
  end() {
    const {claims, problem: {objective: t}} = this;
    const left = [...this.open.values()].filter(box => t === null || cmp(box.lo[t], claims.cap) <= 0);
    need(!claims.infeasible || !left.length, "a box is still open: not proved infeasible", "proof");
    if (claims.epsilon) need(left.every(box => cmp(box.lo[t], claims.epsilon.lo) >= 0), "an open box begins below eps lo", "proof");
    if (claims.enclosure) need(left.every(box => box.lo.every((v, i) => cmp(v, claims.enclosure.lo[i]) >= 0 && cmp(i === t ? min(box.hi[i], claims.cap) : box.hi[i], claims.enclosure.hi[i]) <= 0)), "an open box is not in the enclosure", "proof");
  }
}

// ---- claims --------------------------------------------------------------------------------------------------------
function readClaims(problem, value) {
  const [cap_, infeasible, epsilon_, enclosure_, point_] = fields(value, "cap", "infeasible", "epsilon", "enclosure", "point"), {n, objective: t, lo, hi} = problem;
  const ends = v => { const [low, high] = fields(v, "lo", "hi"); return {lo: numbers(low, n), hi: numbers(high, n)}; };
  need(t !== null || (cap_ === null && epsilon_ === null), "a cap or eps without an objective");
  const claims = {cap: t === null ? null : hexNumber(cap_), infeasible: truth(infeasible), enclosure: orNull(enclosure_, ends), point: orNull(point_, v => readPoint(problem, v))};
  claims.epsilon = orNull(epsilon_, v => { const [low, high] = fields(v, "lo", "hi"); return {lo: hexNumber(low), hi: orNull(high, hexNumber)}; });
  if (t !== null) need(cmp(claims.cap, lo[t]) >= 0 && cmp(claims.cap, hi[t]) <= 0, "the cap is not in the problem's box");
  if (claims.epsilon) {
    need(cmp(claims.epsilon.lo, lo[t]) >= 0 && cmp(claims.epsilon.lo, claims.cap) <= 0, "eps lo is out of its range");
    need(!(problem instanceof Leg) || lo[t].m === 0n, "eps does not begin at 0");
  }
  return claims;
}
function readPoint(problem, value) {
  const [at, holds, readings, factor_, fails] = fields(value, "at", "holds", "readings", "factor", "fails"), factor = orNull(factor_, hexNumber);
  need(factor === null || cmp(factor, ZERO) >= 0 && cmp(factor, ONE) <= 0, "the factor is not from 0 to 1");
  if (typeof holds === "string") need(holds === "all", "holds is neither all nor a list");
  const held = holds === "all" ? problem.numbers : ascending(holds, Number.MAX_SAFE_INTEGER);
  need(held.every(k => problem.spoken.has(k)), "a point holds where a measurement is left out");
  need(readings === null || factor === null, "readings of a point that holds for all of them");
  const signs = readings === null ? held.map(() => "0".repeat(problem.signs)) : list(readings, held.length).map(v => readSigns(problem, v));
  const failing = list(fails).map(row => readRow(problem, row));
  need(new Set(failing.map(row => row[1])).size === failing.length, "a measurement stands twice in fails");
  return {at: numbers(at, problem.n), held, signs, factor, fails: failing, all: held.length === problem.numbers.length};
}
function provePoint(problem, {at, held, signs, factor, fails}) {
  const x = at.map(constant), here = {lo: at, hi: at}, value = poly => poly.t.size ? D(poly.t.get(""), poly.e) : ZERO;
  held.forEach((k, i) => need(factor === null ? holdsAt(problem, k, x, signs[i], value) : holdsForAll(problem, k, x, signs[i], value, factor), `the point is not proved to hold at ${k}`, "proof"));
  for (const row of fails) need(least(rowInU(problem, row, here)).m > 0n, `the point is not proved to fail at ${row[1]}`, "proof");
}
function holdsAt(problem, k, x, signs, value) {
  const ends = [1, -1].map(turn => problem.parts(k, x, problem.rho(k).map((rho, j) => constant(mul(rho, D(turn * ({"+": 1, "-": -1}[signs[j]] || 0)))))));
  const [first, second] = ends.map(p => ({factor: value(p.factor), body: value(p.body), least: p.least && value(p.least), most: p.most && value(p.most)}));
  if (!ends[0].root) return (first.least === null || cmp(first.least, first.body) <= 0) && (first.most === null || cmp(first.body, first.most) <= 0);
  if (first.body.m < 0n) return false;
  if (first.least !== null && first.least.m > 0n && cmp(mul(first.factor, mul(first.least, first.least)), first.body) > 0) return false;
  if (second.most !== null && (second.most.m < 0n || cmp(second.body, mul(second.factor, mul(second.most, second.most))) > 0)) return false;
  return value(problem.lengthRow(k, x)).m <= 0n && !(problem instanceof Leg && value(x[problem.n - 1]).m < 0n);
}
// At the reading where each of the seven makes the leg longest, compared to what it reads, and at the opposite one; what
// a reading may do that is not the same way over all of its set is given away.
function holdsForAll(problem, k, x, signs, value, scale) {
  if (!(problem instanceof Leg)) return holdsAt(problem, k, x, signs, value);
  const {P, q, L} = problem.row(k), rho = problem.rho(k).map(v => mul(v, scale)), at = x.map(value), eps = at[problem.n - 1];
  if (value(problem.lengthRow(k, x, scale)).m > 0n || eps.m < 0n) return false;
  const zero = constant(ZERO), parts = reading => { const p = problem.parts(k, x, reading); return {kappa: value(p.kappa), factor: value(p.factor), body: value(p.body), least: value(p.least), most: value(p.most)}; };
  const p = rho.slice(0, 3), s = rho.slice(3, 6), sizes = v => v.map(size), sum = v => v.reduce(add), whole = D;
  const [w0, ...v] = q, n = dot(q, q), b = at.slice(3, 6), w = P.map((c, i) => sub(c, at[i]));
  const c = [0, 1, 2].map(i => {  // |q|^2 R(q) b
    const twice = whole(2), first = mul(sub(mul(w0, w0), dot(v, v)), b[i]);
    return add(add(first, mul(twice, mul(dot(v, b), v[i]))), mul(twice, mul(w0, cross(v, b)[i])));
  });
  const gain = problem.model === "gain" ? add(ONE, at[7]) : ONE;
  const S = sum(s), most = mul(n, sum(sizes(b))), shift = sum(p);
  if (cmp(add(mul(gain, L), at[6]), add(mul(size(gain), rho[6]), eps)) < 0) return false;
  const turn = cross(c, w), bent = mul(mul(S, most), add(mul(whole(5), mul(S, add(sum(sizes(w)), shift))), mul(whole(3), shift)));
  const reading = [], give = [];
  for (const i of [0, 1, 2]) {
    const [j, l] = [(i + 1) % 3, (i + 2) % 3], g = add(mul(n, w[i]), c[i]), t = turn[i];
    const moved = total_([mul(n, p[i]), mul(whole(2), add(mul(s[j], size(c[l])), mul(s[l], size(c[j])))), mul(whole(3), mul(mul(S, S), most))]);
    reading[i] = g.m > 0n ? p[i] : neg(p[i]);
    give.push(mul(mul(whole(4), p[i]), over(moved, g)));
    const swung = total_([
      mul(size(c[i]), add(mul(s[j], size(w[j])), mul(s[l], size(w[l])))), mul(size(w[i]), add(mul(s[j], size(c[j])), mul(s[l], size(c[l])))),
      mul(whole(2), mul(s[i], size(add(mul(c[j], w[j]), mul(c[l], w[l]))))), mul(p[j], size(c[l])), mul(p[l], size(c[j])), bent]);
    reading[3 + i] = t.m > 0n ? s[i] : neg(s[i]);
    give.push(mul(mul(whole(8), s[i]), over(swung, t)));
  }
  reading[6] = gain.m > 0n ? neg(rho[6]) : rho[6];
  const [high, low] = [1, -1].map(sign => parts(reading.map(v => constant(mul(D(sign), v))))), slack = mul(add(ONE, dot(s, s)), sum(give));
  const bottom = sub(low.body, slack);
  if (high.most.m < 0n || cmp(add(high.body, slack), mul(high.factor, mul(high.most, high.most))) > 0 || bottom.m < 0n) return false;
  return low.least.m <= 0n || cmp(mul(low.factor, mul(low.least, low.least)), bottom) <= 0;
}
const size = a => a.m < 0n ? neg(a) : a, dot = (a, b) => a.map((v, i) => mul(v, b[i])).reduce(add), total_ = parts => parts.reduce(add);
const cross = (a, b) => [0, 1, 2].map(i => sub(mul(a[(i + 1) % 3], b[(i + 2) % 3]), mul(a[(i + 2) % 3], b[(i + 1) % 3])));
const over = (most, slope) => { const left = sub(most, size(slope)); return left.m > 0n ? left : ZERO; };
function checkEnds(problem, {epsilon, point}) {  // eps hi is that of the point
  if (!epsilon || epsilon.hi === null) return;
  need(cmp(epsilon.hi, epsilon.lo) >= 0, "eps hi is below eps lo", "proof");
  need(point !== null && point.all && point.factor === null, "eps hi without a point that holds everywhere for some readings", "proof");
  need(cmp(point.at[problem.objective], epsilon.hi) === 0, "eps hi is not the point's", "proof");
  need(point.at.every((v, i) => cmp(v, problem.lo[i]) >= 0 && cmp(v, problem.hi[i]) <= 0), "the point is not in the problem's box", "proof");
}

// ---- files ---------------------------------------------------------------------------------------------------------
function checkCertificate(bytes, campaign = null) {
  line = 1; work = 0;
  const lines = [];
  for (let start = 0; start < bytes.length;) {
    const end = bytes.indexOf(10, start), stop = end < 0 ? bytes.length : end;
    lines.push(bytes.subarray(start, stop));
    start = stop + 1;
  }
  const parsed = k => {
    line = k + 1;
    need(k < lines.length && lines[k].length, "a line is missing or empty");
    need(lines[k].length <= LIMIT.line, "a line is too long", "limit");
    spend(20 + lines[k].length / 8);
    const value = parseJson(utf8(lines[k]));
    need(value instanceof Map, "is no object");
    return value;
  };
  const problem = readHeader(parsed(0), campaign);
  let at = 1;
  if (problem instanceof Stated) for (const _ of problem.numbers) problem.constraint(parsed(at++));
  const claims = readClaims(problem, parsed(at++));
  checkEnds(problem, claims);
  if (claims.point) provePoint(problem, claims.point);
  const proof = new Proof(problem, claims);
  while (at < lines.length) proof.step(parsed(at++));
  proof.end();
  return {problem, claims, steps: lines.length};
}
function readHeader(value, campaign) {
  const leg = value.has("campaign"), keys = leg ? ["campaign", "leg", "model", "measurements", "only"] : ["about", "unknowns", "objective", "constraints"];
  const header = fields(value, "format", ...keys, "lo", "hi");
  need(header[0] === FORMAT, "is of another format");
  const problem = leg ? new Leg(campaign, header) : new Stated(header);
  need(problem.lo.every((v, i) => cmp(v, problem.hi[i]) <= 0), "the problem's box is empty");
  return problem;
}
function decimal(value) {
  need(typeof value === "string" && /^-?[0-9]{1,30}(\.[0-9]{1,30})?(e[+-]?[0-9]{1,3})?$/.test(value), "is no decimal number");
  need(Number.isFinite(Number(value)), "is too large for a float64");
  return Number(value);
}
function readCampaign(bytes, sha256) {
  line = 0; work = 0;
  const rows = [], names = new Set();
  let legs = 0;
  const each = row => {
    if (!rows.length) legs = (list(row).length - 15) / 2;
    need(legs >= 1 && Number.isInteger(legs), "a measurement has another length");
    const [pose, run, ...cells] = list(row, 15 + 2 * legs), name = text(pose) + "/" + text(run), v = Float64Array.from(cells, decimal);
    need(v.subarray(3, 7).some(c => c) && v.subarray(7 + legs).every(c => c >= 0), "a quaternion is zero, or a half-width negative");
    need(!names.has(name), "two measurements have one name");
    names.add(name);
    rows.push(v);
  };
  try {
    const [format, files, robot, uncertainty, model, provenance, list_] = fields(parseJson(utf8(bytes), each), "format", "files", "robot", "uncertainty", "model", "provenance", "measurements");
    need(format === CAMPAIGN_FORMAT && Array.isArray(list_) && rows.length, "is no campaign");
    return {sha256, legs, rows};
  } catch (error) {
    throw error instanceof Refused ? new Refused(0, "campaign", error.message) : error;
  }
}
