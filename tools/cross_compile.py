"""Compile and link the core for macOS on arm64 and for Windows on x86-64. Nothing of it is run.

Usage: python tools/cross_compile.py [macos] [windows]

The compiler is that of the package ziglang, which brings headers and libraries of both systems.
This Python needs ziglang, cmake, ninja and the build requirements of pyproject.toml. Its own
headers serve, with a pyconfig.h for the other system.
"""

import re
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

ROOT = Path(__file__).parent.parent
TARGETS = {  # triple, system and processor of CMake, the first bytes of an extension module
    "macos": ("aarch64-macos", "Darwin", "arm64", b"\xcf\xfa\xed\xfe\x0c\x00\x00\x01"),
    "windows": ("x86_64-windows-gnu", "Windows", "AMD64", b"MZ"),
}
SIZES = {
    "SHORT": 2,
    "INT": 4,
    "LONG": 4,
    "LONG_LONG": 8,
    "VOID_P": 8,
    "SIZE_T": 8,
    "WCHAR_T": 2,
    "TIME_T": 8,
    "PID_T": 4,
}
WINDOWS = [
    "MS_WINDOWS",
    "MS_WIN32",
    "MS_WIN64",
    "NT_THREADS",
    "WITH_THREAD",
    "HAVE_DECLSPEC_DLL",
    "Py_ENABLE_SHARED",
]


def run(*command: str | Path) -> None:
    print("$", *command, flush=True)
    subprocess.run(command, check=True)


def headers(name: str, folder: Path) -> Path:
    """Make this Python's headers in `folder`, as the other system has them."""
    shutil.copytree(sysconfig.get_path("include"), folder, dirs_exist_ok=True)
    config = folder / "pyconfig.h"
    if name == "windows":
        lines = [f"#define {word} 1" for word in WINDOWS] + [
            f"#define SIZEOF_{word} {size}" for word, size in SIZES.items()
        ]
        config.write_text("\n".join([*lines, ""]))
    else:
        config.write_text(config.read_text() + "\n#define _DARWIN_C_SOURCE 1\n")
    return folder


def import_library(include: Path, folder: Path, zig: list[str]) -> Path:
    """Make an import library of every name that the headers could mean.

    The linker takes those that exist from Python's DLL.
    """
    text = "".join(path.read_text(errors="replace") for path in include.rglob("*.h"))
    version = f"python{sys.version_info.major}{sys.version_info.minor}"
    definition, library = folder / f"{version}.def", folder / f"lib{version}.a"
    names = sorted(set(re.findall(r"\b_?Py\w+", text)))
    definition.write_text("\n".join([f"LIBRARY {version}.dll", "EXPORTS", *names, ""]))
    run(*zig, "dlltool", "-m", "i386:x86-64", "-d", definition, "-l", library)
    return library


def build(name: str) -> None:
    triple, system, processor, magic = TARGETS[name]
    folder = ROOT / "build/cross" / name
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    zig = [sys.executable, "-m", "ziglang"]
    for tool, arguments in {"c++": f"c++ -target {triple}", "ar": "ar", "ranlib": "ranlib"}.items():
        # Zig 0.17 crashes at -bundle.
        shared = (
            'for word; do shift; [ "$word" != -bundle ] || word=-shared; set -- "$@" "$word"; done'
        )
        (folder / tool).write_text(f'#!/bin/sh\n{shared}\nexec {" ".join(zig)} {arguments} "$@"\n')
        (folder / tool).chmod(0o755)
    include = headers(name, folder / "include")
    options = {
        "CMAKE_SYSTEM_NAME": system,
        "CMAKE_SYSTEM_PROCESSOR": processor,
        "CMAKE_CXX_COMPILER": folder / "c++",
        "CMAKE_AR": folder / "ar",
        "CMAKE_RANLIB": folder / "ranlib",
        "CMAKE_BUILD_TYPE": "None",
        "CMAKE_CXX_FLAGS": "-O1 -g0 -Werror",
        "CMAKE_OSX_SYSROOT": "",
        "CLOTHSIM_PRECOMPILE": "OFF",
        "SKBUILD_PROJECT_VERSION": "0",
        "SKBUILD_PROJECT_VERSION_FULL": "0",
        "Python_EXECUTABLE": sys.executable,
        "Python_INCLUDE_DIR": include,
        "pybind11_DIR": subprocess.check_output(
            [sys.executable, "-m", "pybind11", "--cmakedir"], text=True
        ).strip(),
    }
    if name == "windows":
        options["Python_LIBRARY"] = import_library(include, folder, zig)
        (folder / "libdl.a").write_bytes(
            b"!<arch>\n"
        )  # CMake asks for what a static library would need
        options["CMAKE_MODULE_LINKER_FLAGS"] = f"-L{folder}"
    run(
        "cmake",
        "-G",
        "Ninja",
        "-S",
        ROOT,
        "-B",
        folder,
        *(f"-D{key}={value}" for key, value in options.items()),
    )
    run("cmake", "--build", folder)
    (module,) = (path for path in folder.glob("_core*") if path.suffix in (".so", ".pyd", ".dll"))
    content = module.read_bytes()
    if not content.startswith(magic) or b"PyInit__core" not in content:
        raise SystemExit(f"{module} is no extension module for {name}")
    print(
        f"{name}: compiled and linked {module.relative_to(ROOT)}, {len(content):,} bytes",
        flush=True,
    )


if __name__ == "__main__":
    for target in sys.argv[1:] or TARGETS:
        build(target)
