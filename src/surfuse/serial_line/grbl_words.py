"""What the numbers of GRBL 1.1 mean: `ALARM:n` and `error:n` (gnea/grbl, doc/csv, version 1.1)."""

from __future__ import annotations

ALARMS = {
    1: "a limit switch was hit; the position is likely lost",
    2: "the target lies outside of the machine's travel (soft limit); the position is kept",
    3: "it was reset in motion; steps are likely lost",
    4: "the probe was not in its rest state before it was moved",
    5: "the probe touched nothing on its way",
    6: "homing failed: it was reset",
    7: "homing failed: the safety door was opened",
    8: "homing failed: a switch did not open again when it was left",
    9: "homing failed: a switch was not found",
    10: "homing failed: the second switch of a double axis was not found",
}
POSITION_KEPT = (2, 4, 5)
"""Alarms after which the machine still knows where it is: `$X` is enough."""

ERRORS = {
    1: "a letter was expected",
    2: "a number is missing or malformed",
    3: "a '$' command is not known",
    4: "a number that must be positive is negative",
    5: "homing is not enabled ($22)",
    6: "step pulses must be longer than 3 microseconds",
    7: "its settings could not be read; it has the defaults",
    8: "a '$' command came while it was not idle",
    9: "it is locked: in alarm, or jogging",
    10: "soft limits need homing ($22)",
    11: "the line is too long",
    12: "a setting exceeds the highest step rate",
    13: "the safety door is open",
    14: "a start-up line is too long",
    15: "the jog leads out of the travel",
    16: "the jog is malformed",
    17: "laser mode needs a PWM output",
    20: "a G-code is not supported",
    21: "two G-codes of one group are in one line",
    22: "the feed is missing",
    23: "a G-code needs a whole number",
    24: "two G-codes in one line need axes",
    25: "a word is repeated",
    26: "axes are missing",
    27: "the line number is out of its range",
    28: "a word P or L is missing",
    29: "a work coordinate system is not supported",
    30: "G53 needs G0 or G1",
    31: "axes are given that nothing uses",
    32: "an arc has no axes in its plane",
    33: "the target of the motion is invalid, for a probe also when it is where the machine is",
    34: "an arc has a wrong radius",
    35: "an arc has no centre in its plane",
    36: "words are given that nothing uses",
    37: "the tool length offset is not on its axis",
    38: "the tool number is too high",
}
