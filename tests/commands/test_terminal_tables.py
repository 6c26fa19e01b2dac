"""Tables into files and pipes lose no column."""

from rich.table import Table

from flightdepth.commands.terminal import say, show_table


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
