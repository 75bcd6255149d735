"""The wheel carries what the checkout has: contracts travel with the code."""

from __future__ import annotations

import subprocess
import sys
import sysconfig
import venv
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[1]


def test_installed_package_knows_its_contracts(tmp_path: Path) -> None:
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "-q"]
    wheels = tmp_path / "wheels"
    subprocess.run(
        [*pip, "wheel", "--no-deps", "--no-build-isolation", "-w", str(wheels), str(PROJECT)], check=True
    )
    fresh = tmp_path / "fresh"
    venv.create(fresh)
    (wheel,) = wheels.glob("gyrostand-*.whl")
    python = fresh / "bin" / "python"
    subprocess.run([*pip, "--python", str(python), "install", "--no-deps", str(wheel)], check=True)
    # The dependencies are those of this environment, after the fresh one's own packages; an editable
    # install here is not seen there, for a .pth line does not run another folder's .pth files.
    (site,) = (fresh / "lib").glob("python*/site-packages")
    (site / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")

    where = subprocess.run(
        [python, "-c", "import pipeline; print(pipeline.__file__)"],
        capture_output=True,
        text=True,
        check=True,
        cwd=tmp_path,
    )
    assert str(fresh) in where.stdout
    listed = subprocess.run(
        [fresh / "bin" / "gyrostand", "schema", "list"],
        capture_output=True,
        text=True,
        check=True,
        cwd=tmp_path,
    )
    contracts = {p.stem for p in (PROJECT / "schemas").glob("*.json") if not p.name.endswith(".schema.json")}
    assert {line.split()[0] for line in listed.stdout.splitlines()} == contracts
