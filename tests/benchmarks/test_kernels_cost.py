"""benchmarks/kernels.py on two kernels, for a moment."""

import runpy

import pytest
from places import ROOT


def test_the_table_has_the_kernels_asked_for(capsys):
    main = runpy.run_path(str(ROOT / "benchmarks" / "kernels.py"))["main"]
    main(["attitude.multiply", "attitude.to_dcm", "--seconds", "0.0005"])
    head, *lines = capsys.readouterr().out.splitlines()
    assert "/ reference" in head
    assert {line.split()[0] for line in lines} == {"sins_env.attitude.multiply", "sins_env.attitude.to_dcm"}
    assert all(float(cell) > 0 for line in lines for cell in line.split()[1:])
    with pytest.raises(SystemExit):
        main(["nothing"])
    assert "no kernel has nothing in its name; there are: " in capsys.readouterr().err


def test_the_table_of_processes_has_times_and_memory(capsys):
    main = runpy.run_path(str(ROOT / "benchmarks" / "kernels.py"))["main"]
    main(["--processes", "python"])
    head, line = capsys.readouterr().out.splitlines()
    cpu, memory = map(float, line.split()[-2:])
    assert head.split()[-3:] == ["CPU", "s", "MiB"]
    assert 0.0 < cpu < 60.0
    assert 1.0 < memory < 100.0, "its own memory, not that of this process"
