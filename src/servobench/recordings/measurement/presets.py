"""The chains of known devices: what lies between the shaft and the speed that a device reports, each with its source.

Each entry has a public source; for devices that are missing, no published figures were found. The text is a chain for a speed,
with the device's default settings: if you changed them, write the stages out instead.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Preset:
    """The chain of a device's speed by its name.

    `device` is what reports the speed, `chain` the stages as text, `lag` how much it delays slow signals [s], `sources` where its
    figures are published, and `uncertain` what they leave open.
    """

    name: str
    device: str
    chain: str
    lag: float
    sources: tuple[str, ...]
    uncertain: str


_WPILIB = "WPILib, SysId's FeedbackControllerPreset.h (https://github.com/wpilibsuite/allwpilib)"
_PHOENIX_5 = "CTRE, Phoenix 5 API, velocityMeasurementPeriod and velocityMeasurementWindow (https://api.ctr-electronics.com/phoenix)"
_REVLIB = "REV Robotics, REVLib documentation, setMeasurementPeriod and setAverageDepth (https://codedocs.revrobotics.com)"
_SPARK_FRAMES = (
    "The speed is sent every 20 ms unless that was changed (REVLib, setPeriodicFramePeriod): a log that samples in "
    "between is late by 10 ms on average, which `| delay 10 ms` adds."
)
_64_SAMPLES = (
    "The mean of 64 samples, 1 ms apart, is written as an average over the 63 ms between the first and the last: "
    "the same lag."
)

PRESETS: dict[str, Preset] = {
    preset.name: preset
    for preset in (
        Preset(
            name="talon-srx",
            device="CTRE Talon SRX, and Talon FX with Phoenix 5",
            chain="tachometer 100 ms | average 63 ms",
            lag=0.0815,
            sources=(_PHOENIX_5, _WPILIB),
            uncertain=f"{_64_SAMPLES} Period (1 to 100 ms) and samples (1 to 64) are settings; the delay of a bus "
            "frame isn't included.",
        ),
        Preset(
            name="cancoder-5",
            device="CTRE CANcoder with Phoenix 5",
            chain="tachometer 100 ms | average 63 ms",
            lag=0.0815,
            sources=(_PHOENIX_5, _WPILIB),
            uncertain=f"{_64_SAMPLES} Period and samples are settings; the delay of a bus frame isn't included.",
        ),
        Preset(
            name="phoenix-6",
            device="CTRE Talon FX and CANcoder with Phoenix 6",
            chain="delay 1 ms",
            lag=0.001,
            sources=(_WPILIB,),
            uncertain="A Kalman filter whose equations aren't published; WPILib's authors measured about 1 ms. The "
            "period of a signal's frames isn't included.",
        ),
        Preset(
            name="spark-max-neo",
            device="REV SPARK MAX with a NEO's hall sensors",
            chain="average 224 ms",
            lag=0.112,
            sources=(
                "REV support, quoted in WPILib's SysId, issue 258 (https://github.com/wpilibsuite/sysid/issues/258)",
                _WPILIB,
            ),
            uncertain="The mean of 8 samples, 32 ms apart, is written as an average over the 224 ms between the "
            "first and the last. The lag of a single sample isn't published; period and samples are "
            f"settings in later firmware. {_SPARK_FRAMES}",
        ),
        Preset(
            name="spark-max-quadrature",
            device="REV SPARK MAX with a quadrature encoder, the alternate encoder included",
            chain="tachometer 100 ms | average 63 ms",
            lag=0.0815,
            sources=(_REVLIB, _WPILIB),
            uncertain=f"{_64_SAMPLES} WPILib assumes a sample every 1 ms; period and samples are settings. "
            f"{_SPARK_FRAMES}",
        ),
        Preset(
            name="venom",
            device="Playing With Fusion Venom",
            chain="tachometer 10 ms",
            lag=0.005,
            sources=(
                _WPILIB,
                "the maker, in WPILib's SysId, pull request 138 (https://github.com/wpilibsuite/sysid/pull/138)",
            ),
            uncertain="The delay of a bus frame isn't included.",
        ),
        Preset(
            name="odrive",
            device="ODrive 3.x, vel_estimate with encoder.config.bandwidth at 1000 rad/s",
            chain="lowpass 1000 rad/s | lowpass 1000 rad/s",
            lag=0.002,
            sources=(
                "ODrive firmware, MotorControl/encoder.hpp and encoder.cpp "
                "(https://github.com/odriverobotics/ODrive)",
            ),
            uncertain="A phase-locked loop with two equal poles at the bandwidth, whose speed follows the shaft's as "
            "ω²/(s + ω)². "
            "The bandwidth is a setting, lower for hall sensors.",
        ),
        Preset(
            name="moteus",
            device="mjbots moteus, velocity with pll_filter_hz at 400 Hz",
            chain="lowpass 1012.4 rad/s | lowpass 1012.4 rad/s",
            lag=0.001975,
            sources=("moteus firmware, fw/motor_position.h (https://github.com/mjbots/moteus)",),
            uncertain="A phase-locked loop with two equal poles; at 400 Hz its position gain falls to 0.707, which "
            "is 2.482 times the poles' ω. The setting differs for hall sensors.",
        ),
        Preset(
            name="simplefoc",
            device="SimpleFOC, shaft velocity with LPF_velocity.Tf at 5 ms",
            chain="lowpass 200 rad/s",
            lag=0.005,
            sources=(
                "SimpleFOC documentation, Low-Pass velocity filter (https://docs.simplefoc.com/low_pass_filter)",
                "SimpleFOC library, src/common/defaults.h (https://github.com/simplefoc/Arduino-FOC)",
            ),
            uncertain="Tf is a setting that many sketches change; half a pass of the control loop, mostly below 1 "
            "ms, isn't included.",
        ),
        Preset(
            name="quanser-50",
            device="QUBE-Servo courseware, 50 s/(s + 50) on the encoder's position",
            chain="derivative | lowpass 50 rad/s",
            lag=0.02,
            sources=(
                "Quanser, QUBE-Servo courseware, Filtering: the derivative of the encoder's position through "
                "50/(s + 50)",
                "quanser-openai-driver, whose speed is that derivative "
                "(https://github.com/BlueRiverTech/quanser-openai-driver)",
            ),
            uncertain="50 rad/s is the courseware's value, in a block that anybody can change; `derivative` adds "
            "half the sample time of the log, which is the filter's only if every sample was logged.",
        ),
        Preset(
            name="beckhoff-el5032",
            device="Beckhoff EL5032 and EL5001-0090, calculated velocity",
            chain="tachometer 10 ms",
            lag=0.005,
            sources=(
                "Beckhoff Information System, EL5032, Velocity measurement "
                "(https://infosys.beckhoff.com/content/1033/el5032/14568953995.html)",
            ),
            uncertain="The window is a setting (0x80n8:17) and a multiple of the cycle time.",
        ),
    )
}
"""By name, the chains of known devices."""
