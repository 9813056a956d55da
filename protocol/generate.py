"""Turns protocol/schema.toml into everything that speaks the wire.

python protocol/generate.py            writes the generated files
python protocol/generate.py --check    exits 1 and names the stale ones
"""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT / "protocol"), str(ROOT / "host")]

import emit_c  # noqa: E402
import emit_document  # noqa: E402
import emit_python  # noqa: E402
from golden import golden  # noqa: E402
from layout import SchemaError, load  # noqa: E402


def generated(schema_path: Path) -> dict[str, str]:
    """Text of every generated file, by its path below the root."""
    schema = load(schema_path)
    return {
        "firmware/app/wire.h": emit_c.header(schema),
        "firmware/app/wire.c": emit_c.source(schema),
        "host/phaselead/device/wire.py": emit_python.module(schema),
        "docs/wire.md": emit_document.document(schema),
        "protocol/golden.json": golden(schema),
    }


def stale(files: dict[str, str], root: Path) -> list[str]:
    """Paths whose file is missing or says something else."""
    return [p for p, text in files.items() if not (root / p).exists() or (root / p).read_text() != text]


def write(path: Path, text: str) -> None:
    """Atomically, so that a build running beside this never reads half a file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(path.name + ".partial")
    partial.write_text(text)
    os.replace(partial, path)


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--check", action="store_true", help="write nothing; exit 1 when a file is stale")
    parser.add_argument("--root", type=Path, default=ROOT, help="tree to write or check (default: this)")
    parser.add_argument("--schema", type=Path, default=ROOT / "protocol" / "schema.toml")
    options = parser.parse_args(arguments)
    try:
        files = generated(options.schema)
    except SchemaError as error:
        print(f"{options.schema}: {error}", file=sys.stderr)
        return 2
    old = stale(files, options.root)
    if options.check:
        for path in old:
            print(f"{path} is stale: run python protocol/generate.py", file=sys.stderr)
        return 1 if old else 0
    for path in old:
        write(options.root / path, files[path])
        print(f"wrote {path}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
