"""Firmware that differs from the shipped sources in one named point, for the tests.

``BROKEN[board][name]`` is a list of edits of ``arduino/``. Most take a safety rule away, and a test
must notice that; some only choose another value of a board's header. In
:mod:`tests.firmware.building` ``built`` makes ``firmware/BOARD-NAME.elf`` of an edited copy of the
sources, and ``host_library`` makes the same for this computer. An edit whose text is not there
exactly once fails the build: the rule has moved, and so must its control.
"""

from __future__ import annotations

from pathlib import Path

Edit = tuple[str, str, str]
"""File below the board's folder, text that it holds exactly once, and what replaces that."""


class EditFailed(Exception):
    """An edit does not fit the sources; the message names variant, file and text."""


HANGS: Edit = (
    "drum.ino",
    "    unsent = drum.modbus().take(received.byte);\n",
    "    unsent = drum.modbus().take(received.byte);\n"
    "    while (drum.bank().wide(reg::move_target) == -32000) {\n    }\n",
)
_HANGS_LATER: Edit = (
    "chip_main.cpp",
    "        talk.take(sampling::take_frame());\n",
    "        talk.take(sampling::take_frame());\n"
    "        static uint16_t frames;\n        while (frames == 200) {\n        }\n"
    "        frames++;\n",
)
_CLEAR_COMPARE = '        "ldi r24, %[ocf1b]\\n"\n        "out %[tifr1], r24\\n"\n'

_SWAPPED: Edit = (
    "chip_bridge.cpp",
    "void drive(int16_t permille) {\n",
    "void drive(int16_t permille) {\n    permille = -permille;\n",
)

# The upper switch is believed alone, where no zero of the load cell contradicts it.
_SWITCH_ALONE: list[Edit] = [
    (
        "signals.h",
        "return says_top() && (reads_position() ? !far_from_top() : left_top_);",
        "return says_top();",
    ),
    ("signals.h", " || apart_ms_ >= BROKEN_MS;", ";"),
]

BROKEN: dict[str, dict[str, list[Edit]]] = {
    "drum": {
        "hangs": [HANGS],
        "unwatched": [HANGS, ("chip_reset.cpp", "    wdt_enable(WDTO_60MS);\n", "")],
        "forgets-hangs": [HANGS, ("chip_reset.cpp", "    watched = WATCHED;\n", "")],
        "no-estop": [("chip_estop.cpp", "    EIMSK |= _BV(INT5);\n", "")],
        "one-look": [
            (
                "steady_level.h",
                "return expected ^ (first & second & third);",
                "return expected ^ (first | (second & third & 0));",
            )
        ],
        "swapped": [_SWAPPED],
        # Swapped wires, and one of the rules for them missing.
        "swapped-unwatched": [
            _SWAPPED,
            ("motion_watch.cpp", "    return compare(duty, signals);", "    return Finding::None;"),
        ],
        "swapped-at-once": [
            _SWAPPED,
            ("motion_watch.cpp", "    ramp_ += RAMP_PERMILLE;\n", "    ramp_ = Actuator::FULL;\n"),
        ],
        "position-believed": [
            ("signals.h", "fitted(Signal::Position) && !broken_ms_;", "fitted(Signal::Position);"),
            ("signals.h", "return broken_ms_ >= BROKEN_MS ||", "return"),
            (
                "contact.cpp",
                "    if (sensor_.reads_contact()) return at_every_top(whole);\n",
                "",
            ),
            ("contact.cpp", "    if (sensor_.reads_contact()) return false;\n", ""),
        ],
        "switch-believed": [
            (
                "contact.cpp",
                "    if (sensor_.reads_contact()) return at_every_top(whole);\n",
                "    if (signals_.says_top()) return true;\n"
                "    if (sensor_.reads_contact()) return false;\n",
            )
        ],
        "switch-alone": _SWITCH_ALONE,
        "blind-push": [
            (
                "contact_watch.cpp",
                "sample.position_um - from_um_ > most_um ? Fault::ForceMissing : Fault::None",
                "most_um ? Fault::None : Fault::ForceMissing",
            ),
            ("contact_watch.cpp", "was_settled_ && beyond(", "false && beyond("),
        ],
        "bottomless": [
            ("contact.h", "return place_known_ && signals_", "return false && signals_"),
        ],
        # The set-up presses with a load cell that has felt nothing.
        "unfelt": [("commands.cpp", "    if (!controller_.cell_trusted()) return false;\n", "")],
        # Each boot forgets where the drum last touched.
        "forgetful": [("commands.cpp", "    controller_.recall_place();\n", "")],
        "quick-lift": [
            (
                "controller.h",
                "gentle() const { return !commission_.holds(); }",
                "gentle() const { return false; }",
            )
        ],
        # An emergency stop while the computer is away leaves no trace, and the computer clears it.
        "heartbeat-hides": [
            ("machine.cpp", " || (fault_ == Fault::Heartbeat && fault != fault_)", "")
        ],
        # What could not lift is tried again, and presses a little more each time.
        "tries-again": [
            ("controller.cpp", " || needs_restart()) return false;", ") return false;")
        ],
        "always-commissioned": [
            ("commission.h", "return ports::commissioned() == hash_;", "return hash_ != 0;")
        ],
        "deaf": [
            (
                "heartbeat.h",
                "return age_ms_ >= limit_ms;",
                "return age_ms_ >= limit_ms && age_ms_ > 60000;",
            )
        ],
        "gain-10": [("force_loop.cpp", "speed = target.gain_p *", "speed = 10 * target.gain_p *")],
        "unguarded": [
            (
                "controller.cpp",
                "    if (!resting() || signals_.estop_open()) return false;\n",
                "    return true;\n",
            )
        ],
        "estop-configurable": [
            (
                "controller.cpp",
                "    if (!resting() || signals_.estop_open()) return false;\n",
                "    if (signals_.estop_open()) return true;\n    if (!resting()) return false;\n",
            )
        ],
        "any-scale": [
            (
                "bank.cpp",
                "    if (value > -setting.least && value < setting.least) return false;\n",
                "",
            )
        ],
        "no-raw-limit": [
            (
                "zero.cpp",
                "return known_ && !within(raw, most_counts_);",
                "return false && !within(raw, most_counts_);",
            )
        ],
        "short-lift": [
            (
                "controller.cpp",
                "(contact_.gone() && lifting_ms >= LIFT_TIME_MS)",
                "lifting_ms >= LIFT_TIME_MS",
            )
        ],
        # Both ends together are the upper one, which no other wire has to support.
        "both-ends-believed": [
            *_SWITCH_ALONE,
            ("signals.h", "return end_up() && !end_down();", "return end_up();"),
        ],
        "tare-in-contact": [
            (
                "taring.cpp",
                "    if (!forced && !free) return false;\n",
                "    static_cast<void>(free);\n",
            )
        ],
        "one-sample": [("force_sensor.cpp", "sampling.slow ? 1 : 2;", "sampling.slow ? 1 : 1;")],
        "spikes-felt": [("loadcell.h", "sampling_->slow ? raw() : steady_raw_", "raw()")],
        "any-rate": [
            ("loadcell.cpp", "    if (rate_wrong_) bits |= bit(Fault::LoadcellRate);\n", "")
        ],
        "untested-cell": [
            ("loadcell.cpp", "    if (test_.failed()) bits |= bit(Fault::LoadcellNoise);\n", "")
        ],
        "any-direction": [
            ("motion_watch.cpp", "    return compare(duty, signals);", "    return Finding::None;")
        ],
        "pressing-lift": [("controller.cpp", "if (!first && !lifts_surely()) {", "if (!first) {")],
        "lighter-lifts": [
            ("controller.cpp", "never_shown = gentle() &&", "never_shown = false &&")
        ],
        "loose-cell": [
            ("commands.cpp", "    if (!controller_.sensor().reads_zero()) return false;\n", ""),
            ("force_control.cpp", "if (contact_watch_.pulls(force_dg_, for_setup_))", "if (false)"),
        ],
        # An emergency stop that closes when it is pressed.
        "normally-open": [("board.h", "SIGNALS_INVERTED = 0;", "SIGNALS_INVERTED = 1;")],
        # Twice the steps a millimetre: at 160 mm/s more than 10,000 a second in contact.
        "fine": [("board.h", "MICROSTEPS = 16;", "MICROSTEPS = 32;")],
    },
    "taxels": {
        "stuck-counter": [("chip_sampling.cpp", "counter = samples++;", "counter = samples;")],
        "never-clear": [
            ("chip_sampling.cpp", _CLEAR_COMPARE, ""),
            ("chip_sampling.cpp", "    TIFR1 = _BV(OCF1B);\n", ""),
        ],
        # An interrupt starts each conversion: whatever is being served delays the sample.
        "by-software": [
            ("chip_sampling.cpp", "_BV(ADIE) | _BV(ADATE) |", "_BV(ADIE) |"),
            (
                "chip_sampling.cpp",
                "    TCCR1B = _BV(ICES1)",
                "    TIMSK1 = _BV(OCIE1B);\n    TCCR1B = _BV(ICES1)",
            ),
            (
                "chip_sampling.cpp",
                "// An edge of sync or index.",
                "ISR(TIMER1_COMPB_vect) { ADCSRA = CONVERT | _BV(ADSC); }\n"
                "// An edge of sync or index.",
            ),
        ],
        # 250 kbaud carry 25 bytes a millisecond and a frame has 33: frames must be dropped.
        "slow-wire": [("board.h", "UBRR_VALUE = 3;", "UBRR_VALUE = 7;")],
        "hangs": [_HANGS_LATER],
        "forgets-hangs": [_HANGS_LATER, ("chip_reset.cpp", "    watched = WATCHED;\n", "")],
        "never-kick": [("chip_main.cpp", "        reset::kick();\n", "")],
    },
    "finger": {
        "state-in-float": [
            ("neurons.h", "typedef double NeuronState;", "typedef float NeuronState;")
        ],
        "gain-not-interpolated": [
            (
                "neurons.cpp",
                "    return gains[knot] + (((int32_t(gains[knot + 1]) - gains[knot]) * into) "
                ">> shift);\n",
                "    return gains[knot] + 0 * into;\n",
            )
        ],
        "distance-in-float": [
            (
                "scaled_time.cpp",
                "    distance_nm_ += velocity_um_per_s;\n",
                "    distance_nm_ = uint64_t(float(distance_nm_) + float(velocity_um_per_s));\n",
            )
        ],
    },
}


def edited_copy(arduino: Path, board: str, name: str, folder: Path) -> Path:
    """Write the sources of a broken board below ``folder``; return that copy of ``arduino/``.

    Files that are the same already keep their time, so that make builds only what changed. Raises
    EditFailed where an edit does not fit.
    """
    copy = folder / "arduino"
    files = [
        path for path in arduino.rglob("*") if path.is_file() and "__pycache__" not in path.parts
    ]
    texts = {path.relative_to(arduino): path.read_bytes() for path in files}
    for file, old, new in BROKEN[board][name]:
        path = Path(board) / file
        found = texts[path].count(old.encode())
        if found != 1:
            raise EditFailed(
                f"{board}-{name}: arduino/{path} holds {found} times, not once, the text {old!r}: "
                "adapt BROKEN in tests/firmware/broken.py"
            )
        texts[path] = texts[path].replace(old.encode(), new.encode())
    for path, content in texts.items():
        target = copy / path
        if not target.is_file() or target.read_bytes() != content:
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(content)
    return copy
