"""Every command accepts only options that it uses: for each pair of command and option, what the option changes."""

import argparse
import json

import pytest
import synthetic_results
from campaign_cases import finish, make_small

from campaign import __main__ as command_line
from campaign import products
from campaign.__main__ import COMMANDS, OPTIONS, main
from campaign.evaluate import Print


@pytest.fixture
def case(tmp_path, monkeypatch):
    """A finished campaign in a folder that is not the default one; engines and analysis note what they are given."""
    case = finish(make_small(tmp_path))
    case.calls, case.default = [], tmp_path / "root" / "runs" / "small"

    def note(name, answer):
        def noted(*args, **options):
            case.calls.append((name, *[a for a in args if a == case.folder or a == case.default], options))
            if hasattr(args[0], "run"):
                case.calls[-1] += (args[0].run.jobs, args[0].run.engine)
            return answer

        return noted

    monkeypatch.setattr(command_line, "RUNS", tmp_path / "root" / "runs")
    monkeypatch.setattr("campaign.engine_local.run_missing", note("local", 0))
    monkeypatch.setattr("campaign.engine_slurm.submit_missing", note("slurm", "submitted"))
    for name, answer in (("analyse", ("line", None)), ("archive", "line"), ("report", "line")):
        monkeypatch.setattr(f"campaign.evaluate.{name}", note(name, answer))
    for name in OF_RESULTS:
        monkeypatch.setattr(
            f"campaign.compare.{name}", lambda _, target, name=name: case.calls.append((name, target)) or "line"
        )
    return case


def answer(case, capsys, command, *options, folder=True):
    """Exit code, output and what engines and analysis were given; `folder`: with --folder."""
    case.calls.clear()
    where = ("--folder", str(case.folder)) if folder else ()
    code = main([command, str(case.toml), *where, *options])
    return code, capsys.readouterr().out, list(case.calls)


def folder_is_where_the_campaign_is(case, capsys, command):
    assert not case.default.exists()
    code, _, calls = answer(case, capsys, command)
    assert code == 0 and not case.default.exists()
    assert all(case.folder in call for call in calls)
    code, _, calls = answer(case, capsys, command, folder=False)
    assert code != 0 or case.default.exists() or all(case.default in call for call in calls)
    assert not any(case.folder in call for call in calls)


def jobs_goes_to_the_engine(case, capsys, command):
    assert all("local" in call and 3 in call for call in answer(case, capsys, command, "--jobs", "3")[2][:1])
    assert not any(3 in call for call in answer(case, capsys, command)[2])


def jobs_changes_the_time_to_go(case, capsys, command):
    for row in case.rows[-4:]:
        (case.folder / row.product).unlink()
    seconds = [
        json.loads(answer(case, capsys, command, "--json", "--jobs", jobs)[1])["seconds_to_go"] for jobs in ("1", "4")
    ]
    assert seconds[0] > 2 * seconds[1] > 0


def engine_is_the_one_that_runs(case, capsys, command):
    assert answer(case, capsys, command, "--engine", "slurm")[2][0][0] == "slurm"
    assert answer(case, capsys, command, "--engine", "local")[2][0][0] == "local"


def failed_runs_are_repeated(case, capsys, command):
    assert [answer(case, capsys, command, *o)[2][0][2]["again"] for o in (("--failed",), ())] == [True, False]
    slurm = ("--engine", "slurm")
    assert [answer(case, capsys, command, *slurm, *o)[2][0][2]["again"] for o in (("--failed",), ())] == [True, False]


def quiet_goes_to_the_engine(case, capsys, command):
    assert [answer(case, capsys, command, *o)[2][0][2]["quiet"] for o in (("--quiet",), ())] == [True, False]


def json_is_printed(case, capsys, command):
    assert json.loads(answer(case, capsys, command, "--json")[1])["counts"]["total"]["done"] == 10
    with pytest.raises(json.JSONDecodeError):
        json.loads(answer(case, capsys, command)[1])


def check_reads_products_that_look_unchanged(case, capsys, command):
    answer(case, capsys, command)
    path, checked = case.product(), case.folder / "products" / products.CHECKED
    data = bytearray(path.read_bytes())
    data[-1] ^= 1
    path.write_bytes(data)
    entries = json.loads(checked.read_text())
    entries[case.rows[-1].run_id]["stamp"] = products.file_stamp(path)
    checked.write_text(json.dumps(entries))
    assert case.rows[-1].run_id not in answer(case, capsys, command)[1]
    assert case.rows[-1].run_id in answer(case, capsys, command, "--check")[1]


def interactive_goes_to_the_report(case, capsys, command):
    assert answer(case, capsys, command, "--interactive")[2][0][2]["interactive"] is True
    assert answer(case, capsys, command)[2][0][2]["interactive"] is False


def yes_removes_what_is_listed(case, capsys, command):
    left = case.folder / "products" / "shear_of_earlier_settings.h5"
    left.write_bytes(b"old")
    assert left.name in answer(case, capsys, command)[1] and left.exists()
    assert left.name in answer(case, capsys, command, "--yes")[1] and not left.exists()


def to_is_where_the_output_goes(case, capsys, command):
    results = str(synthetic_results.example(noise=0.02))
    target = case.folder / "there"
    case.calls.clear()
    assert main([command, results, *[results] * (command == "compare"), "--to", str(target)]) == 0
    assert case.calls == [(command, target)] and capsys.readouterr().out == "line\n"


def print_options_go_to_the_figures(case, capsys, command):
    wanted = [answer(case, capsys, command, *o)[2][0][2]["wanted"]
              for o in ((), ("--figures", "svg"), ("--figures", "png", "--columns", "1", "--dpi", "300"))]  # fmt: skip
    assert wanted == [None, Print("svg", 2, 600), Print("png", 1, 300)]


def swept(case, capsys, *options, folder=True):
    """Output and calls of a sweep over two values; its campaigns stay without products, since no engine runs."""
    case.toml.write_text(case.toml.read_text().replace("n = 2\n", "n = 8\n"))
    values = () if "--set" in options else ("--set", "shear.strain_end=0.1,0.08")
    code, out, calls = answer(case, capsys, "sweep", *values, *options, folder=folder)
    assert code == 3 and [call[0] for call in calls] == ["local", "local"]
    return out, calls


def a_sweep_has_its_own_folder(case, capsys, command):
    swept(case, capsys)
    assert (case.folder / "shear.strain_end=0.08" / "points.csv").exists() and not case.default.parent.exists()
    swept(case, capsys, folder=False)
    assert (case.default.with_name("small_sweep") / "shear.strain_end=0.1" / "points.csv").exists()


def run_options_go_to_the_engine_of_every_value(case, capsys, command):
    calls = swept(case, capsys, "--jobs", "3", "--failed", "--quiet")[1]
    assert all(call[1]["again"] and call[1]["quiet"] and call[2] == 3 for call in calls)
    calls = swept(case, capsys)[1]
    assert not any(call[1]["again"] or call[1]["quiet"] or call[2] == 3 for call in calls)


def values_are_swept_with_those_that_go_along(case, capsys, command):
    options = ("--set", "pdem.cells=64,128", "--with", "pdem.method=exact,tvd")
    assert "pdem.cells = 64\n" in swept(case, capsys, *options)[0]
    text = (case.folder / "pdem.cells=128" / "config.toml").read_text()
    assert 'cells = 128\nmethod = "tvd"\n' in text


USES = {("status", "--jobs"): jobs_changes_the_time_to_go, ("status", "--json"): json_is_printed}
OF_RESULTS = ("compare", "export")
USES |= {(command, "--folder"): folder_is_where_the_campaign_is for command in COMMANDS if command not in OF_RESULTS}
USES |= {(command, "--to"): to_is_where_the_output_goes for command in OF_RESULTS}
USES |= {("report", "--interactive"): interactive_goes_to_the_report, ("prune", "--yes"): yes_removes_what_is_listed}
USES["sweep", "--folder"] = a_sweep_has_its_own_folder
USES |= {("sweep", o): run_options_go_to_the_engine_of_every_value for o in ("--jobs", "--failed", "--quiet")}
USES |= {("sweep", o): values_are_swept_with_those_that_go_along for o in ("--set", "--with")}
USES |= {(command, "--check"): check_reads_products_that_look_unchanged for command in ("status", "missing")}
USES |= {("report", option): print_options_go_to_the_figures for option in ("--figures", "--columns", "--dpi")}
for _command in ("run", "all"):
    USES[_command, "--jobs"] = jobs_goes_to_the_engine
    USES[_command, "--engine"] = engine_is_the_one_that_runs
    USES[_command, "--failed"] = failed_runs_are_repeated
    USES[_command, "--quiet"] = quiet_goes_to_the_engine


@pytest.mark.parametrize(("command", "option"), USES, ids=[" ".join(pair) for pair in USES])
def test_an_accepted_option_has_its_effect(case, capsys, command, option):
    USES[command, option](case, capsys, command)


def test_no_command_accepts_an_option_without_a_test_of_its_effect():
    (commands,) = (a for a in command_line._parser()._actions if isinstance(a, argparse._SubParsersAction))
    accepted = {
        (name, option)
        for name, parser in commands.choices.items()
        for action in parser._actions
        for option in action.option_strings
        if option.startswith("--") and option != "--help"
    }
    assert accepted == set(USES) and {option for _, option in accepted} == set(OPTIONS)


@pytest.mark.parametrize("options, said", [
    (("--figures", "eps"), "--figures = 'eps' is not one of pdf, svg, png"),
    (("--figures", "pdf", "--dpi", "71"), "--dpi = 71 is outside [72, 1200]"),
    (("--figures", "png", "--dpi", "1201"), "--dpi = 1201 is outside [72, 1200]"),
    (("--figures", "svg", "--columns", "3"), "--columns = 3 is not 1 or 2 (columns of a journal)"),
    (("--dpi", "300"), "--dpi has an effect with --figures only"),
    (("--columns", "1"), "--columns has an effect with --figures only"),
])  # fmt: skip
def test_figures_for_print_that_are_not_possible_are_refused_in_one_line(case, capsys, options, said):
    for source in (str(case.toml), str(case.folder / "results.h5")):
        assert main(["report", source, "--folder", str(case.folder), *options]) == 2
        assert capsys.readouterr() == ("", f"campaign: {said}\n") and case.calls == []
