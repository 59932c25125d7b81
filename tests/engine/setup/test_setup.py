"""A setup is left and continued, described in rig.toml, refused where it would not be safe."""

from __future__ import annotations

from pathlib import Path

import pytest

from rigctl.boards.drum_codes import Status
from rigctl.boards.port_discovery import PortReport
from rigctl.config.rig_config import SLOW_GAINS, Actuator, LoadCell, RigConfig, load_config
from rigctl.engine.setup.boards import judge_firmware, judge_reports
from rigctl.engine.setup.check_result import DONE, YES_OR_NO, Question
from rigctl.engine.setup.progress import COMMISSION, load_progress, progress_path
from rigctl.engine.setup.setup import STEPS, Setup
from rigctl.errors import WrongUse
from rigctl.values import BoardIdentity
from tests.engine.setup.simulated_setup import DAY, SimulatedSetup, simulated_setup

MINE = "# My rig.\n[inverted]\n# The stop is as drawn.\nestop = false\n"


def take_all(setup: SimulatedSetup, upto: str = "") -> None:
    """Take the steps until one is wrong, or until ``upto`` is next."""

    async def steps(whole: Setup) -> None:
        while (step := whole.next) is not None and step.name != upto and setup.wrong is None:
            result = await whole.check(step.name)
            setup.wrong = None if result.passed else result

    setup.run(steps)


def test_nothing_moves_before_the_parts_before_have_passed() -> None:
    async def steps(setup: Setup) -> None:
        for name in ("actuator", "turn", "press", COMMISSION, "trial"):
            with pytest.raises(WrongUse, match="first check Boards and ports"):
                await setup.check(name)

    with simulated_setup() as setup:
        setup.run(steps)
        assert setup.peak_g == 0 and "watch_rod" not in setup.asked


def test_a_port_that_another_program_holds_is_what_the_setup_names() -> None:
    held = PortReport(
        "/dev/ttyACM0", "", error="the port is in use: close the program that holds it"
    )
    result = judge_reports([PortReport("/dev/ttyS0", "", error="no rigctl board answered"), held])
    assert result.problem == "/dev/ttyACM0: the port is in use: close the program that holds it"


def test_without_room_the_actuator_does_not_move() -> None:
    with simulated_setup() as setup:
        setup.answers["make_room"] = "neither"
        with pytest.raises(WrongUse, match="take the sensor out, or make 5 mm of room"):
            setup.run_through()
        assert "watch_rod" not in setup.asked


def test_a_mass_that_is_not_what_was_typed_is_found() -> None:
    with simulated_setup() as setup:
        setup.answers["mass_second"] = "900"
        setup.rig.simulation.hands._acts["lay_mass"] = lambda g: setup.rig.faults.push(
            500.0 if g > 200 else g
        )
        setup.run_through()
        assert setup.step is not None and setup.step.name == "scale"
        assert setup.wrong is not None and "not proportional to the masses" in setup.wrong.problem


def test_one_wrong_mass_of_two_in_proportion_is_found_by_the_label() -> None:
    with simulated_setup() as setup:
        setup.answers |= {"mass_first": "50", "mass_second": "125"}
        setup.rig.simulation.hands._acts["lay_mass"] = lambda g: setup.rig.faults.push(4 * g)
        setup.run_through()
        assert setup.wrong is not None and "a mass is not what was typed" in setup.wrong.problem


def test_an_amplifier_at_ten_samples_passes_where_rig_toml_says_so() -> None:
    gains = Actuator(gain_p_per_s=SLOW_GAINS[0], gain_i_per_s=SLOW_GAINS[1])
    config = RigConfig(loadcell=LoadCell(rate_hz=10), actuator=gains)
    with simulated_setup("cell at 10 samples a second", config=config) as setup:
        setup.run_through()
        assert setup.wrong is None and setup.peak_g < 300


def test_rig_toml_describes_a_part_as_it_is_wired_and_keeps_comments(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(MINE)

    async def steps(setup: Setup) -> None:
        while (step := setup.next) is not None:
            if (await setup.check(step.name)).passed:
                continue
            assert step.name == "actuator"
            assert await setup.keep(step.name) == "[inverted] position = true"
            assert (await setup.check(step.name)).passed

    with simulated_setup("potentiometer reversed") as setup:
        setup.rig.path = path
        setup.run(steps)
        assert setup.peak_g < 300
    text = path.read_text()
    assert "# My rig.\n[inverted]\n# The stop is as drawn.\nestop = false\n" in text
    config = load_config(path)
    assert config.inverted.position and config.loadcell.calibrated == f"{DAY} with 200 g, 500 g"
    assert config.ports.drum == "drum"


def test_a_setup_is_left_and_continued_where_it_was(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(MINE)
    with simulated_setup() as setup:
        setup.rig.path = path
        take_all(setup, upto="cell")
    with simulated_setup() as setup:
        setup.rig.path, setup.rig.config = path, load_config(path)

        async def go_on(whole: Setup) -> None:
            assert whole.next is not None and whole.next.name == "cell"
            assert not whole.progress.remarks
            whole.begin_again()
            assert whole.next.name == "ports"

        setup.run(go_on)


def progress_of(tmp_path: Path, boots: int, text: str) -> None:
    whole = f'{{"boots": {boots}, "passed": {{{text}}}}}'
    progress_path(tmp_path / "rig.toml").write_text(whole)


@pytest.fixture
def board() -> BoardIdentity:
    with simulated_setup() as setup:
        return setup.rig.loop.run_until_complete(setup.rig.drum.connect())


def test_progress_of_another_board_is_refused_with_the_cure(
    tmp_path: Path, board: BoardIdentity
) -> None:
    progress_of(tmp_path, board.boot_count + 7, "")
    with pytest.raises(WrongUse, match=r"belongs to another drum board .* connect that one, or"):
        load_progress(tmp_path / "rig.toml", board, RigConfig(), True)


def test_a_rig_toml_that_contradicts_what_was_found_has_its_part_checked_again(
    tmp_path: Path, board: BoardIdentity
) -> None:
    kept = '{"day": "2026-01-02", "found": "", "kept": {"loadcell": {"scale_ug_per_count": 2412}}}'
    progress_of(tmp_path, 0, f'"scale": {kept}, "cell": {{"day": "2026-01-02", "found": ""}}')
    progress = load_progress(tmp_path / "rig.toml", board, RigConfig(), True)
    assert progress.remarks == [
        "scale: rig.toml says [loadcell] scale_ug_per_count = 2400, setup had found 2412; it is "
        "checked again"
    ]
    assert list(progress.passed) == ["cell"]


def test_a_board_that_is_not_commissioned_is_commissioned_again(
    tmp_path: Path, board: BoardIdentity
) -> None:
    progress_of(tmp_path, 0, '"commission": {"day": "2026-01-02", "found": ""}')
    progress = load_progress(tmp_path / "rig.toml", board, RigConfig(), False)
    assert not progress.passed
    assert "not commissioned for its present settings" in progress.remarks[0]


@pytest.mark.parametrize("text", ["", "{", "[]", '{"boots": "1"}', "\x00" * 9])
def test_a_damaged_progress_is_one_sentence(
    tmp_path: Path, board: BoardIdentity, text: str
) -> None:
    progress_path(tmp_path / "rig.toml").write_text(text)
    with pytest.raises(WrongUse, match=r"delete it to begin the setup again$"):
        load_progress(tmp_path / "rig.toml", board, RigConfig(), True)


def test_an_experienced_user_commissions_without_checks_and_hears_what_was_skipped() -> None:
    async def at_once(setup: Setup) -> None:
        state = await setup.context.look()
        assert not state.status_bits >> Status.COMMISSIONED & 1
        skipped = await setup.commission_without()
        assert skipped == tuple(s.title for s in STEPS if s.name != COMMISSION)
        state = await setup.context.look()
        assert state.status_bits >> Status.COMMISSIONED & 1

    with simulated_setup() as setup:
        setup.run(at_once)
        assert setup.peak_g == 0


def test_a_board_with_another_build_is_named_with_the_command_that_flashes_it() -> None:
    result = judge_firmware({"drum": "aa", "taxels": "bb"}, {"drum": "aa", "taxels": "cc"})
    assert "load it with rigctl flash taxels" in result.problem
    assert judge_firmware({"drum": "aa", "taxels": "bb"}, {"drum": "aa", "taxels": ""}).passed


def test_a_failed_part_loses_its_pass() -> None:
    async def steps(setup: Setup) -> None:
        assert (await setup.check("ends")).passed
        setup.context.rig.faults.wire("end switches swapped")
        assert not (await setup.check("ends")).passed
        assert "ends" not in setup.progress.passed

    with simulated_setup() as setup:
        setup.run(steps)


MILLIMETRES = Question("circumference", "How long?", (), "mm", 50, 5000)


@pytest.mark.parametrize(
    ("question", "answer", "taken"),
    [
        (Question("a", "?"), "", DONE),
        (Question("a", "?", YES_OR_NO), " Y", "yes"),
        (Question("a", "?", YES_OR_NO), "no", "no"),
        (MILLIMETRES, "400", "400"),
        (MILLIMETRES, "400,5 mm", "400.5"),
        (MILLIMETRES, "400.5", "400.5"),
    ],
)
def test_answers_are_taken_as_people_write_them(
    question: Question, answer: str, taken: str
) -> None:
    assert question.checked(answer) == taken


@pytest.mark.parametrize("answer", ["", "x", "1,000.5", "1.000,5", "4", "1e9", "nan", "inf"])
def test_an_impossible_number_is_refused(answer: str) -> None:
    with pytest.raises(WrongUse, match="a number from 50 to 5000 mm"):
        MILLIMETRES.checked(answer)


def test_an_answer_that_is_no_choice_is_refused() -> None:
    with pytest.raises(WrongUse, match="answer yes or no"):
        Question("a", "?", YES_OR_NO).checked("maybe")
