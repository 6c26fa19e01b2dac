"""What is kept of compiled code, where several processes compile at once."""

import os

from flightdepth.renderers.compiling import announce_compiling, compiled


def doubled(number):
    return 2 * number


def test_two_processes_that_saw_the_same_files_keep_their_code_in_different_ones(monkeypatch):
    """Each finds the first number free; were it one file, the later process's code would answer the earlier's calls."""
    files = compiled(doubled)._cache._cache_file
    mine = files._data_name(1)
    monkeypatch.setattr(os, "getpid", lambda: -1)
    assert files._data_name(1) != mine


def test_code_is_found_again(tmp_path, monkeypatch):
    files = compiled(doubled)._cache._cache_file
    monkeypatch.setattr(files, "_cache_path", str(tmp_path))
    monkeypatch.setattr(files, "_index_path", str(tmp_path / files._index_name))
    files.save("ints", b"code for ints")
    monkeypatch.setattr(os, "getpid", lambda: 1)
    files.save("floats", b"code for floats")
    assert (files.load("ints"), files.load("floats")) == (b"code for ints", b"code for floats")
    assert len(list(tmp_path.glob("*.nbc"))) == 2


def test_the_first_wait_is_told_once_and_a_warm_start_is_not(tmp_path, monkeypatch, caplog):
    function = compiled(doubled)
    files = function._cache._cache_file
    monkeypatch.setattr(files, "_cache_path", str(tmp_path))
    monkeypatch.setattr(files, "_index_path", str(tmp_path / files._index_name))
    announce_compiling(function)
    announce_compiling(function)
    assert [record.message for record in caplog.records] == [
        "the renderer is compiled first, once on this machine: about a minute"
    ]
    files.save("ints", b"code for ints")
    announce_compiling.cache_clear()  # as in another process
    announce_compiling(function)
    assert len(caplog.records) == 1
