"""Tables into files and pipes lose no column, bars on narrow terminals no figure."""

from rich.console import Console
from rich.table import Table

from flightdepth.commands.terminal import progress_bar, say, show_table


def test_an_address_is_said_as_it_is(capsys):
    """`:a:` is a picture to Rich."""
    say("page: http://[fd00::a:5]:8080/")
    assert capsys.readouterr().out == "page: http://[fd00::a:5]:8080/\n"


def test_a_table_in_a_pipe_is_as_wide_as_it_is(capsys):
    table = Table(*(f"column {i:02d}" for i in range(30)))
    table.add_row(*(f"figure {i:02d}" for i in range(30)))
    show_table(table)
    printed = capsys.readouterr().out
    for i in range(30):
        assert f"column {i:02d}" in printed
        assert f"figure {i:02d}" in printed
    assert len({len(line) for line in printed.splitlines()}) == 1


def test_a_narrow_terminal_shortens_the_bar_and_no_figure(capsys):
    """`3317504/3317…` stood there, and `samples/s` on a line of its own."""
    with progress_bar("stage for-lenses-3, loss 3.569 m", 3_317_504, "samples") as bar:
        bar.begin_at(1_317_504, 3_317_504)
        bar.tasks[0].finished_speed = 1989.0
        capsys.readouterr()
        Console(width=80).print(bar.make_tasks_table(bar.tasks))
        (line,) = capsys.readouterr().out.splitlines()
    assert line.startswith("stage for-lenses-3, loss 3.569 m ")
    assert " 1317504/3317504 1989.0 samples/s " in line
