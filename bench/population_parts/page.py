"""A motor on a line."""

from population_parts.judge import Row, causes, off, stated

_SHORT = {
    "gain": "K",
    "time_constant": "τ",
    "delay": "d",
    "coulomb_voltage": "u_c",
    "lag": "T",
    "offset_voltage": "u₀",
    "speed_at_level": "ω",
    "acceleration": "K/τ",
}


def line(row: Row) -> str:
    """Return what came of a motor in a line: what it was, the verdict, errors in standard deviations, false causes."""
    far = " ".join(f"{_SHORT[name]} {z:.3g} sd" for name, z in off(row).items())
    ways = "both" if row["both_ways"] else "one"
    what = (
        f"{row['number']:5} {row['input']:10} {row['output']:14} {row['start']:7} {ways:4} {row['rows']:5} rows "
        f"τ/Ts {row['tau_over_sample']:5.0f} u_c {100 * row['coulomb_share']:2.0f} % d {row['delay_samples']:3.1f}"
    )
    known = " ".join(
        f"{_SHORT[name]} ± {_relative(one):.2g} %"
        for name, one in stated(row).items()
        if name in ("gain", "time_constant", *row.get("combinations", ()))
    )
    least = max(row["bound"]["gain"], row["bound"]["time_constant"])
    return (
        f"{what} bound {100 * least:7.2g} %  {row['verdict']:9} {row['seconds']:5.2f} s  {known}"
        + (f"  OFF {far}" if far else "")
        + (f"  causes {', '.join(causes(row))}" if causes(row) else "")
    )


def _relative(one: tuple[float, float, float, float]) -> float:
    return 100.0 * one[1] / abs(one[0]) if one[0] else float("inf")
