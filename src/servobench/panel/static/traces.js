// Which scopes there are, and which traces each of them has. A trace's colour is a token of the style sheet, `--trace-NAME`; those
// of one scope also differ in their line. `follows` is the unit that a reference has to have, to be the scope's.
// `least` is what is as good as nothing, in the scope's unit: less than its readings tell.

export const SCOPES = [
    {
        id: "voltage",
        title: "Voltage",
        unit: "V",
        least: 1e-3,
        shown: true,
        traces: [
            { column: "applied", title: "Applied", shown: true, line: "wide" },
            { column: "commanded", title: "Commanded", shown: true, line: "dashed", note: "dashed, over the applied one" },
        ],
    },
    {
        id: "speed",
        title: "Speed",
        unit: "rad/s",
        least: 1e-3,
        shown: true,
        traces: [
            { column: "speed_raw", title: "Raw", shown: false, line: "thin" },
            { column: "reference", title: "Reference", shown: true, line: "dotted", follows: "rad/s" },
            { column: "speed", title: "Filtered", shown: true },
        ],
    },
    {
        id: "position",
        title: "Position",
        unit: "angle",
        shown: true,
        traces: [
            { column: "reference", title: "Reference", shown: true, line: "dotted", follows: "rad" },
            { column: "position", title: "Position", shown: true },
        ],
    },
    {
        id: "current",
        title: "Current",
        unit: "A",
        least: 1e-4,
        shown: false,
        traces: [{ column: "current", title: "Current", shown: true }],
    },
    {
        id: "residual",
        title: "Residual",
        unit: "angle",
        shown: false,
        traces: [{ column: "residual", title: "Live model", shown: true }],
    },
];

const DEGREE = Math.PI / 180;

// An angle's unit as a person chose it: {unit, factor from rad, column}.
export const ANGLES = {
    counts: { unit: "counts", title: "Counts" },
    deg: { unit: "deg", title: "Degrees", factor: 1 / DEGREE },
    rad: { unit: "rad", title: "Radians", factor: 1 },
};

// The unit of the reference, which is that of what the controller follows.
export function referenceUnit(controller) {
    if (!controller || controller.type === "open_loop") return "V";
    return controller.output === "speed" ? "rad/s" : "rad";
}
