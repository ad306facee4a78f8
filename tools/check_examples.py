"""Type checkers accept every Python example of the documentation, and refuse an unknown name.

Usage: python tools/check_examples.py

The blocks of a page are one program, as a reader types them; names that a page takes for granted
are in given.pyi. Each page and each script of examples/ goes through mypy and pyright.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
SOURCES = ROOT / "python"
# docs/howto shows parts of the package's own files, which are no programs.
PAGES = [
    ROOT / "README.md",
    *sorted(page for page in (ROOT / "docs").rglob("*.md") if page.parent.name != "howto"),
]
BLOCK = re.compile(r"^```(?:python|pycon)\n(.*?)^```", re.MULTILINE | re.DOTALL)
PROMPT = re.compile(r"(?:>>>|\.\.\.) ?")
REFUSED = 'import clothsim as cs\n\ncs.Sphere(response="rey")\n'


def program(text: str) -> str:
    """Return the Python blocks of a page at their own lines: messages then point into the page."""
    lines = [""] * (text.count("\n") + 1)
    for block in BLOCK.finditer(text):
        first = text.count("\n", 0, block.start(1))
        code = block[1].splitlines()
        if any(line.startswith(">>>") for line in code):  # a session: what is printed is no code
            code = [PROMPT.sub("", line, count=1) if PROMPT.match(line) else "" for line in code]
        lines[first : first + len(code)] = code
    if not any(lines):
        return ""
    lines[0] = "import clothsim as cs; from given import *"  # the first line of a page is its title
    return "\n".join(lines) + "\n"


def mypy(folder: Path, *files: str) -> subprocess.CompletedProcess[str]:
    """mypy as users run it, without --strict; only errors of the examples are shown."""
    config = folder / "mypy.ini"
    config.write_text(
        f"[mypy]\nmypy_path = {SOURCES}\nfollow_imports = silent\ncheck_untyped_defs = True\n"
        "allow_redefinition = True\nwarn_unused_ignores = True\n"
        "[mypy-bpy.*,dask.*,dask_jobqueue.*,dask_kubernetes.*,distributed.*,numba.*,scipy.*,wgpu.*]\n"
        "ignore_missing_imports = True\nfollow_imports = skip\nfollow_imports_for_stubs = True\n"
    )
    cache = ROOT / ".mypy_cache" / "examples"
    command = ["mypy", "--config-file", str(config), "--cache-dir", str(cache), *files]
    return run(folder, command)


def pyright(folder: Path, *files: str) -> subprocess.CompletedProcess[str]:
    """pyright in its basic mode."""
    settings = {
        "extraPaths": [str(SOURCES)],
        "include": list(files),
        "reportMissingImports": "none",
        "reportMissingModuleSource": "none",
        "reportUnusedExpression": "none",
    }
    (folder / "pyrightconfig.json").write_text(json.dumps(settings))
    return run(folder, ["pyright", "--pythonpath", sys.executable, "--project", str(folder)])


def run(folder: Path, command: list[str]) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", *command]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True)


def main() -> int:
    failures = 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "given.pyi").write_text((ROOT / "tools" / "given.pyi").read_text())
        files = []
        for page in PAGES:
            if code := program(page.read_text()):
                files.append(re.sub(r"\W", "_", str(page.relative_to(ROOT))) + ".py")
                (folder / files[-1]).write_text(code)
        for script in sorted((ROOT / "examples").glob("*.py")):
            files.append(f"examples_{script.name}")
            (folder / files[-1]).write_text(script.read_text())
        (folder / "refused.py").write_text(REFUSED)
        for checker in (mypy, pyright):
            accepted = checker(folder, *files)
            if accepted.returncode:
                print(accepted.stdout + accepted.stderr)
                failures += 1
            refusal = checker(folder, "refused.py")
            if refusal.returncode != 1 or "rey" not in refusal.stdout:
                print(
                    f"{checker.__name__} must refuse {REFUSED!r}:\n{refusal.stdout}{refusal.stderr}"
                )
                failures += 1
        print(f"mypy and pyright have read the examples of {len(files)} files")
    return failures


if __name__ == "__main__":
    sys.exit(main())
