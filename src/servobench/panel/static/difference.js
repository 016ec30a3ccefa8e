// How far two results lie apart: in units of the standard deviation of both together, and what that means.

const CHANCE = 2; // of them: more in 1 of 20 figures of the same motor
const NO_CHANCE = 3; // more in 1 of 370
const SHOWN = 10; // beyond that a number says nothing more

// How often chance alone puts two results of the same thing so far apart, or farther: erfc(z/√2), by the rational approximation
// 7.1.26 of Abramowitz and Stegun, Handbook of Mathematical Functions, 1964; wrong by 1.5e-7 at most.
export function byChance(z) {
    const x = Math.abs(z) / Math.SQRT2;
    const t = 1 / (1 + 0.3275911 * x);
    const sum = ((((1.061405429 * t - 1.453152027) * t + 1.421413741) * t - 0.284496736) * t + 0.254829592) * t;
    return sum * Math.exp(-x * x);
}

// Whether a parameter is one that the data tell.
export const isTold = (parameter) => Boolean(parameter) && [parameter.value, parameter.sd, ...(parameter.interval ?? [null])].every(Number.isFinite);

// {level, z, words} of a parameter `b` against `a`; `level` is one of a light's, `z` null where they can't be held against each other.
export function difference(a, b) {
    const unknown = (words) => ({ level: "off", z: null, words });
    if (!isTold(a) || !isTold(b)) return unknown("nothing to compare it with");
    if (a.unit !== b.unit) return unknown(`can't be held against ${a.unit}`);
    const sd = Math.hypot(a.sd, b.sd);
    if (!(sd > 0)) return unknown("no standard deviation is known");
    const z = Math.abs(b.value - a.value) / sd;
    const apart = z > SHOWN ? `more than ${SHOWN} sd apart` : `${z.toFixed(1)} sd apart`;
    if (z < CHANCE) return { level: "ok", z, words: `agrees: ${apart}` };
    if (z < NO_CHANCE) return { level: "warn", z, words: `may differ: ${apart}, by chance in 1 of ${Math.round(1 / byChance(z))}` };
    return { level: "bad", z, words: `differs: ${apart}` };
}

// What all differences of one result come to, in a sentence.
export function summary(name, first, differences) {
    const told = differences.filter(({ z }) => z !== null);
    if (!told.length) return `${name} and ${first} have no figure in common that could be compared.`;
    const named = (level) => told.filter((each) => each.level === level).map(({ title }) => title.toLowerCase());
    const [apart, maybe] = [named("bad"), named("warn")];
    if (apart.length) return `${name} differs from ${first} in ${listed(apart)}: that is no chance, so something else differed: the motor, its load, or how it was measured.`;
    if (maybe.length) return `${name} may differ from ${first} in ${listed(maybe)}: take another recording to see whether that is chance.`;
    return `${name} agrees with ${first}: no difference is more than what chance makes.`;
}

export const listed = (names) => (names.length > 1 ? `${names.slice(0, -1).join(", ")} and ${names.at(-1)}` : names[0]);
