"use strict";
// The page checks itself. A worker, made of checker.js and this file, checks the certificates that the page holds and
// compares each number shown with what they claim; the page then says so beside the numbers. It asks no network.

const PARAMETERS = ["a_x", "a_y", "a_z", "b_x", "b_y", "b_z", "l"];
const EXTRA = {plain: [], gain: ["s"], lateral: ["h"]};

// ---- in the worker ---------------------------------------------------------------------------------------------------
function sha256(bytes) {
  const primes = [];
  for (let n = 2; primes.length < 64; n++) if (primes.every(p => n % p)) primes.push(n);
  const fraction = (n, root) => (n ** (1 / root) % 1) * 4294967296 | 0;
  const h = primes.slice(0, 8).map(p => fraction(p, 2)), k = primes.map(p => fraction(p, 3)), w = new Int32Array(64);
  const padded = new Uint8Array((bytes.length + 72 >> 6) * 64), view = new DataView(padded.buffer);
  padded.set(bytes);
  padded[bytes.length] = 128;
  view.setBigUint64(padded.length - 8, BigInt(bytes.length) * 8n);
  const turn = (v, n) => v >>> n | v << 32 - n;
  for (let at = 0; at < padded.length; at += 64) {
    let [a, b, c, d, e, f, g, z] = h;
    for (let i = 0; i < 64; i++) {
      if (i < 16) w[i] = view.getInt32(at + 4 * i);
      else {
        const x = w[i - 15], y = w[i - 2];
        w[i] = w[i - 16] + w[i - 7] + (turn(x, 7) ^ turn(x, 18) ^ x >>> 3) + (turn(y, 17) ^ turn(y, 19) ^ y >>> 10);
      }
      const t = z + (turn(e, 6) ^ turn(e, 11) ^ turn(e, 25)) + (e & f ^ ~e & g) + k[i] + w[i] | 0;
      const u = (turn(a, 2) ^ turn(a, 13) ^ turn(a, 22)) + (a & b ^ a & c ^ b & c) | 0;
      [a, b, c, d, e, f, g, z] = [t + u | 0, a, b, c, d + t | 0, e, f, g];
    }
    [a, b, c, d, e, f, g, z].forEach((v, i) => { h[i] = h[i] + v | 0; });
  }
  return h.map(v => (v >>> 0).toString(16).padStart(8, "0")).join("");
}

async function inflated(base64) {
  const packed = Uint8Array.from(atob(base64), c => c.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

// What a certificate proves of a leg of this campaign: {lo, hi, claims, names}; or {refused}, a text.
function proofOf({leg, name, bytes}, campaign, digest) {
  try {
    if (campaign instanceof Refused) throw campaign;
    const {problem, claims} = checkCertificate(bytes, campaign), {about, lo, hi} = problem;
    let names = EXTRA[about.model] && [...PARAMETERS, ...EXTRA[about.model]];
    let same = about.leg === leg && about.only === null;
    const own = "about" in about;
    if (own) {  // a user-defined model: the certificate states its constraints, which nobody compares with the campaign
      const found = /^leg ([0-9]+), model ([A-Za-z_][A-Za-z0-9_]*), campaign ([0-9a-f]{64})$/.exec(about.about);
      same = found && found[1] === String(leg) && found[3] === digest && !(found[2].toLowerCase() in EXTRA);
      const unknowns = parseJson(utf8(bytes.subarray(0, bytes.indexOf(10)))).get("unknowns");
      names = [...PARAMETERS, ...unknowns.slice(7, -1)];
    }
    return same ? {lo, hi, claims, names, own} : {refused: `${name} is of another leg or campaign, or of some measurements only`};
  } catch (error) {
    if (!(error instanceof Refused)) throw error;
    return {refused: error.code === "campaign" ? `the campaign: ${error.message}` : `${name}, line ${error.line}: ${error.message}`};
  }
}

// The bracket that is proved; hi: null without a point of the box that satisfies every equation.
function bracket({lo, hi, claims: {epsilon, point, infeasible, cap}}) {
  const last = lo.length - 1, inside = point && point.all && point.factor === null && point.at.every((v, i) => (i === last || cmp(v, lo[i]) >= 0) && cmp(v, hi[i]) <= 0);
  return {lo: infeasible ? cap : epsilon ? epsilon.lo : ZERO, hi: inside ? point.at[last] : null};
}

// What a point meets whatever the readings are, by the kind of its certificate and by what the page states of it.
const ABOUT = {recommended: "recommended", "recommended.largest": "recommended", "passes.eps": "passes", "reduced.factor": "reduced"};
const kindOf = claim => ABOUT[claim] || (claim.startsWith("ranges.") ? "ranges" : "bracket");

// Of all readings at all measurements: the number claimed; null without such a claim.
function met({names, claims: {point}}, claim, parameter) {
  if (!point || !point.all || point.factor === null) return null;
  if (claim === "reduced.factor") return point.factor;
  if (cmp(point.factor, ONE)) return null;
  const k = claim === "recommended" ? names.indexOf(parameter) : names.length;
  return k < 0 ? null : point.at[k];
}

function claimed(proof, claim, parameter) {
  if (claim in ABOUT) return met(proof, claim, parameter);
  const {enclosure, cap, infeasible} = proof.claims, found = bracket(proof), side = claim.slice(-2), k = proof.names.indexOf(parameter);
  if (claim === "eps_lo") return infeasible ? null : found.lo;
  if (claim === "eps_hi") return found.hi;
  if (claim === "ranges.eps") return cap;
  if (k < 0) return null;
  if (claim === "point") return found.hi && proof.claims.point.at[k];
  if (enclosure && claim.startsWith("enclosure") && found.hi && cmp(cap, found.hi)) return null;  // it must hold all up to eps_hi
  const hull = enclosure || (infeasible && !found.hi ? null : proof);  // where none is claimed the box is one
  return hull && hull[side] ? hull[side][k] : null;
}

// Why a decimal text is no print of the number: "" where it is. side -1: rounded down; 1: up; 0: to the nearest.
// wide: of a width, which has two digits.
function misprint(text, value, side, wide = false) {
  const found = /^(-?)([0-9]{1,400})(?:\.([0-9]{0,400}))?(?:e([+-]?[0-9]{1,3}))?$/.exec(text);
  if (!found) return `${text} is no number`;
  const [, sign, whole, part = "", power = "0"] = found, places = Number(power) - part.length;
  const coarse = wide && !part && whole.length > 2 && /0$/.test(whole) ? 10n ** BigInt(whole.length - 2) : 1n;  // two digits of it count
  if (!cmp(floatNumber(Number(text)), value)) return "";
  const ten = 10n ** BigInt(Math.abs(places)), two = 1n << BigInt(Math.abs(value.e));
  let printed = BigInt(whole + part) * (sign ? -1n : 1n), unit = 1n, exact = value.m;  // all times the same
  if (places < 0) exact *= ten; else { printed *= ten; unit = ten; }
  if (value.e >= 0) exact *= two; else { printed *= two; unit *= two; }
  const over = (printed - exact) * (side < 0 ? -1n : 1n), size = over < 0n ? -over : over;
  if (side && over < 0n) return `${text} is not rounded to the side that is proved`;
  return (side ? size < unit * coarse : 2n * size <= unit) ? "" : `${text} is not the number that is proved`;
}

// Whether measurements determine the parameters is computed in floating point; no certificate speaks of it.
const UNJUDGED = "Not judged here: whether the measurements determine the parameters; `cpcal verify` computes that again.";
const OWN = "its certificate holds, of constraints that it states itself: these were not compared with the campaign";
const OPEN = /undetermined|not compared/;

// The word that is proved of a leg at a tolerance; "" where neither is, null where nothing is claimed.
function word(leg, tolerance, proofs) {
  const t = tolerance && hexNumber(tolerance), holds = kind => proofs[`${leg} ${kind}`] && !proofs[`${leg} ${kind}`].refused && proofs[`${leg} ${kind}`];
  const bounds = holds("bracket"), best = holds("recommended"), largest = best && met(best, "recommended.largest");
  if (!t || !bounds && !best) return null;
  if (bounds && (cmp(bracket(bounds).lo, t) > 0 || bounds.claims.infeasible && cmp(bounds.claims.cap, t) >= 0)) return "fail";
  return largest && cmp(largest, t) <= 0 ? "pass" : "";
}

// Why a verdict on a leg is not proved; null where it is none that a certificate speaks of.
function misstated(text, tolerance, leg, proofs) {
  const [bounds, best] = ["bracket", "recommended"].map(kind => proofs[`${leg} ${kind}`]), refused = [bounds, best].find(proof => proof && proof.refused);
  if (refused) return refused.refused;
  const proved = word(leg, tolerance, proofs), {hi} = bounds ? bracket(bounds) : {hi: null}, within = / to within ([-+.0-9e]+) mm$/.exec(text);
  const fits = /^(fits|explains) /.test(text), never = /^does not (fit|explain)$/.test(text);
  if (text === "pass" || text === "fail") return text === proved ? "" : proved === null && tolerance ? null : `a ${text} is not proved`;
  if (proved && !OPEN.test(text)) return `a ${proved} is proved`;
  if (!bounds || !fits && !never) return null;
  if (never) return bounds.claims.infeasible ? "" : "it is not refuted";
  return hi === null ? "no fit is proved" : within ? misprint(within[1], hi, 1) : hi.m ? "no exact fit is proved" : "";
}

// Why the verdict on all legs together is not proved.
function misjudged(text, tolerance, proofs, legs) {
  const refused = Object.values(proofs).find(proof => proof.refused), words = legs.map(leg => word(leg, tolerance, proofs)), unknown = words.includes(null);
  if (refused) return refused.refused;
  if (!["PASS", "FAIL", "UNDECIDED"].includes(text)) return "it is no verdict";
  if (words.includes("fail")) return text === "FAIL" ? "" : "a fail is proved";
  if (text === "UNDECIDED") return "";
  return unknown ? null : text === "PASS" && words.every(Boolean) ? "" : `a ${text.toLowerCase()} is not proved`;
}

// Why a number shown is not proved: "" where it is, null where no certificate speaks of it.
function fault({leg, claim, parameter, value, text}, proofs, {digest, count, legs, tolerances}) {
  if (claim === "campaign") return text === digest ? "" : "the campaign in this page has another SHA-256";
  if (claim === "count") return text.replace(/,/g, "") === String(count) ? "" : `the campaign in this page has ${count} measurements`;
  if (claim === "tolerance") return tolerances.some(other => other !== value) ? "another tolerance stands elsewhere" : misprint(text, hexNumber(value), 0);
  if (claim === "overall") return misjudged(text, value, proofs, legs);
  if (claim === "box") {
    const width = mul(D(2), hexNumber(value)), narrow = Object.entries(proofs).some(([key, {lo, hi}]) => !Object.values(ABOUT).includes(key.split(" ")[1]) && lo && PARAMETERS.some((_, i) => cmp(sub(hi[i], lo[i]), width) < 0));
    return narrow ? "a certificate is about a smaller box" : misprint(text, hexNumber(value), 0);
  }
  if (claim === "verdict") return misstated(text, value, leg, proofs);
  const proof = proofs[`${leg} ${kindOf(claim)}`];
  if (!proof) return null;
  if (proof.refused) return proof.refused;
  const side = /lo$|factor$/.test(claim) ? -1 : /hi$|largest$|passes.eps$/.test(claim) ? 1 : 0;
  if (value === "inf" || value === "-inf") {  // states nothing, but for eps_lo
    if (text !== value.replace("inf", "∞")) return `${text} is not what is proved`;
    return claim === "eps_lo" ? proof.claims.infeasible ? null : "no certificate claims it" : (value === "inf") === (side > 0) ? "" : "no certificate claims it";
  }
  if (claim.endsWith(".width")) {
    const [lo, hi] = ["lo", "hi"].map(end => claimed(proof, claim.replace("width", end), parameter));
    if (lo && hi) return misprint(text, sub(hi, lo), 1, true);
    return text === "∞" ? "" : "no certificate claims both ends";
  }
  const stated = hexNumber(value), proved = claimed(proof, claim, parameter);
  if (proved === null) return "no certificate claims it";
  if (cmp(stated, proved)) return "the certificate claims another number";
  if (claim === "reduced.factor") {  // of the recommended parameters, at the tolerance
    const {at} = proof.claims.point, best = proofs[`${leg} recommended`], t = tolerances[0];
    if (!t || cmp(at.at(-1), hexNumber(t))) return "the certificate is of another tolerance";
    if (best && best.claims && met(best, "recommended.largest") && best.claims.point.at.slice(0, -1).some((v, i) => cmp(v, at[i]))) return "the certificate is of other parameters";
  }
  return misprint(text, stated, claim === "ranges.eps" ? -1 : side);
}

// All certificates and numbers: {faults: one a number; marks: good, wrong, none (nothing speaks of it), or own; proofs:
// {leg, name, refused, seconds} each; own: legs whose certificates state their constraints}.
function judged(campaignBytes, certificates, shown, tell = () => {}) {
  const digest = sha256(campaignBytes), proofs = {}, told = [];
  let campaign;
  try { campaign = readCampaign(campaignBytes, digest); } catch (error) { if (!(error instanceof Refused)) throw error; campaign = error; }
  certificates.forEach((certificate, k) => {
    tell(k);
    const {leg, kind, name} = certificate, began = Date.now(), proof = proofOf(certificate, campaign, digest);
    proofs[`${leg} ${kind}`] = proof;
    told.push({leg, name, refused: proof.refused || "", seconds: (Date.now() - began) / 1000});
  });
  const verdicts = shown.filter(({claim}) => claim === "verdict"), about = {
    digest, count: campaign instanceof Refused ? 0 : campaign.rows.length,
    legs: [...new Set(verdicts.map(({leg}) => leg))], tolerances: verdicts.map(({value}) => value).filter(Boolean)};
  const faults = shown.map(number => {
    try { return fault(number, proofs, about); } catch (error) { if (error instanceof Refused) return error.message; throw error; }
  });
  const own = [...new Set(Object.keys(proofs).filter(key => proofs[key].own).map(key => key.split(" ")[0]))];
  const owned = ({leg, claim}) => own.includes(leg) || own.length > 0 && claim === "overall";
  const marks = shown.map((number, k) => faults[k] ? "wrong" : faults[k] === null ? "none" : owned(number) ? "own" : "good");
  return {faults, marks, proofs: told, own};
}

async function serve({data, shown}) {
  const certificates = await Promise.all(data.certificates.map(async c => ({...c, bytes: await inflated(c.deflated)})));
  postMessage(judged(await inflated(data.campaign), certificates, shown, done => postMessage({done, of: certificates.length})));
}

// ---- in the page -----------------------------------------------------------------------------------------------------
function begin(source) {
  const get = id => document.getElementById(id), button = get("proof-again"), data = JSON.parse(get("proof-data").textContent);
  const spots = [...document.querySelectorAll("[data-claim]")], notes = [...document.querySelectorAll("[data-proof]")];
  function say(element, text, state = "") { element.textContent = text; element.className = `proof ${state}`; }
  function unable(why) { [get("proof-status"), ...notes].forEach(e => say(e, `not checked in this browser: ${why}`, "refuted")); button.disabled = false; }
  function show({faults, marks, proofs, own}) {
    const seconds = list => `${list.reduce((sum, p) => sum + p.seconds, 0).toFixed(1)} s`;
    spots.forEach((spot, k) => {
      spot.classList.toggle("refuted", marks[k] === "wrong");
      spot.title = {wrong: `refused: ${faults[k]}`, none: OPEN.test(spot.textContent) ? UNJUDGED : "not certified", own: OWN, good: "as its certificate proves; checked in this browser"}[marks[k]];
    });
    for (const note of notes) {
      const mine = proofs.filter(p => String(p.leg) === note.dataset.proof), of = spots.map((s, k) => k).filter(k => spots[k].dataset.leg === note.dataset.proof);
      const bad = [...mine.filter(p => p.refused).map(p => p.refused), ...of.filter(k => faults[k]).map(k => `“${spots[k].textContent.trim()}”: ${faults[k]}`)];
      const open = of.filter(k => faults[k] === null).length;
      const told = bad.length ? "" : own.includes(note.dataset.proof) ? OWN : "";
      if (bad.length) say(note, `REFUSED: ${bad[0]}${bad.length > 1 ? `; and ${bad.length - 1} more` : ""}`, "refuted");
      else if (told) say(note, `${told}; ${seconds(mine)}`);
      else if (mine.length) say(note, `checked in this browser, ${seconds(mine)}: ${of.length - open} statements${open ? `; ${open} not certified` : ""}`, "held");
    }
    const bad = faults.filter(Boolean).length + proofs.filter(p => p.refused).length, held = marks.filter(mark => mark === "good").length;
    if (bad) say(get("proof-status"), `REFUSED: this page is not what its certificates prove, in ${bad} place${bad > 1 ? "s" : ""}, marked red.`, "refuted");
    else if (own.length) say(get("proof-status"), `Not compared with the campaign: leg ${own.join(", ")}, whose certificates state their constraints themselves. ${held} other statements are proved. ${UNJUDGED}`);
    else say(get("proof-status"), `${proofs.length} certificate${proofs.length > 1 ? "s" : ""} checked in this browser, ${seconds(proofs)}; ${held} statements of this page are what they prove. ${UNJUDGED}`, "held");
    button.disabled = false;
  }
  function run() {
    button.disabled = true;
    [get("proof-status"), ...notes].forEach(e => say(e, "being checked in this browser …"));
    if (typeof Worker === "undefined" || typeof BigInt === "undefined" || typeof DecompressionStream === "undefined") return unable("it is too old");
    const url = URL.createObjectURL(new Blob([get("proof-checker").textContent, "\n", source], {type: "text/javascript"}));
    let worker;
    try { worker = new Worker(url); } catch (error) { return unable(error.message); }
    const shown = spots.map(({dataset: {leg, claim, parameter, value}, textContent}) => ({leg, claim, parameter, value, text: textContent.replace(/\s+/g, " ").trim()}));
    worker.onerror = worker.onmessageerror = event => { unable(event.message || "the worker does not start"); worker.terminate(); };
    worker.onmessage = ({data: told}) => {
      if ("done" in told) { say(get("proof-status"), `being checked in this browser: ${told.done} of ${told.of} certificates`); return; }
      show(told);
      worker.terminate();
      URL.revokeObjectURL(url);
    };
    worker.postMessage({data, shown});
  }
  button.addEventListener("click", run);
  button.hidden = false;
  run();
}

if (typeof document !== "undefined") begin(document.currentScript.textContent);
else globalThis.onmessage = ({data}) => serve(data).catch(error => setTimeout(() => { throw error; }));
