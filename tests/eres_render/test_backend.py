"""Choosing a Mitsuba variant on machines with a good, a bad and no LLVM."""

import json
import os
from pathlib import Path

import pytest

import another_process
from eres_render import BackendError
from eres_render.rendering import backend

BAD_LLVM = Path("/usr/lib/x86_64-linux-gnu/libLLVM-15.so")


def run_python(code, tmp_path, **environment):
    """Run code in a fresh process with its own cache; return (stdout, stderr)."""
    run = another_process.run_python(
        code, timeout_s=600, **{"ERES_CACHE": str(tmp_path)} | environment
    )
    return run.stdout, run.stderr


SELECT = """
import json, logging
from dataclasses import asdict
from eres_render.rendering.backend import probe_variants, select_variant
logging.basicConfig()
print(json.dumps([[asdict(v) for v in probe_variants()], select_variant()]))
"""


@pytest.mark.slow
@pytest.mark.skipif(not BAD_LLVM.exists(), reason="needs Debian 12's LLVM 15")
def test_an_llvm_that_aborts_the_process_is_survived_and_reported(tmp_path):
    """LLVM 15 ends the process; expected: scalar rendering, and one warning that says what to
    install."""
    out, err = run_python(SELECT, tmp_path, DRJIT_LIBLLVM_PATH=str(BAD_LLVM))
    verdicts, chosen = json.loads(out)
    llvm = next(v for v in verdicts if v["name"] == "llvm_ad_mono")
    assert not llvm["works"]
    assert "Cannot select" in llvm["reason"]
    assert chosen == "scalar_rgb"
    warnings = [
        line
        for line in err.splitlines()
        if line.startswith("WARNING:eres_render.rendering.backend")
    ]
    assert len(warnings) == 1
    assert "apt-get install libllvm19" in warnings[0]
    assert "60x slower" in warnings[0]


def test_verdicts_are_remembered_until_the_library_changes(tmp_path, monkeypatch):
    probed = []

    def probe(name):
        probed.append(name)
        return backend.VariantVerdict(name, name == "scalar_rgb", 0.1, "because")

    monkeypatch.setenv("ERES_CACHE", str(tmp_path))
    monkeypatch.setattr(backend, "_probe", probe)
    first = backend.probe_variants()
    assert [v.name for v in first] == list(backend.VARIANTS) == probed
    assert backend.probe_variants() == first
    assert len(probed) == 3

    library = tmp_path / "libLLVM.so"
    library.write_text("another library")
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", str(library))
    backend.probe_variants()
    assert len(probed) == 6
    os.utime(library, ns=(1, 1))
    backend.probe_variants()
    assert len(probed) == 9


@pytest.mark.parametrize(
    ("code", "limit_s", "reason"),
    [
        ("import time; time.sleep(60)", 0.1, "no answer within 0.1 s"),
        ("import os, signal; os.kill(os.getpid(), signal.SIGKILL)", 60.0, "exit status -9"),
    ],
)
def test_a_machine_too_busy_to_tell_is_asked_again(tmp_path, monkeypatch, code, limit_s, reason):
    """Promise: after a stall or a lack of memory, eres tries the variant again later."""
    monkeypatch.setenv("ERES_CACHE", str(tmp_path))
    with monkeypatch.context() as patch:
        patch.setattr(backend, "_PROBE", code)
        patch.setattr(backend, "_PROBE_LIMIT_S", limit_s)
        assert {(v.works, v.reason) for v in backend.probe_variants()} == {(False, reason)}
        patch.setattr(backend, "_PROBE_LIMIT_S", 60.0)
        patch.setattr(backend, "_probe", lambda name: backend.VariantVerdict(name, True, 0.1, ""))
        assert all(verdict.works for verdict in backend.probe_variants())


def test_a_damaged_verdict_is_made_again(tmp_path, monkeypatch):
    verdict = backend.VariantVerdict("scalar_rgb", True, 0.1, "")
    monkeypatch.setenv("ERES_CACHE", str(tmp_path))
    monkeypatch.setattr(backend, "_probe", lambda name: verdict)
    backend.probe_variants()
    for file in (tmp_path / "variants").iterdir():
        file.write_text("{")
    assert backend.probe_variants() == [verdict] * 3


def test_a_forced_variant_must_be_known_and_work(monkeypatch):
    monkeypatch.setenv("ERES_VARIANT", "scalar_rbg")
    with pytest.raises(
        BackendError, match="ERES_VARIANT: found 'scalar_rbg', expected one of cuda"
    ):
        backend.select_variant()
    monkeypatch.setenv("ERES_VARIANT", "cuda_ad_mono")
    broken = backend.VariantVerdict("cuda_ad_mono", False, 0.1, "no driver")
    monkeypatch.setattr(backend, "probe_variant", lambda name: broken)
    with pytest.raises(BackendError, match="cuda_ad_mono does not work here: no driver"):
        backend.select_variant()
