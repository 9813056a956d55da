"""What a check leaves out where a tool is missing: said in a line of its own, and a failure where CI could have had it.

CI is where the environment says CI=true, as GitHub and GitLab do; there a tool that apt offers must not be missing.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterable


def apt_offers(package: str) -> bool:
    if shutil.which("apt-cache") is None:
        return False
    said = subprocess.run(["apt-cache", "policy", package], capture_output=True, text=True, check=False).stdout
    return re.search(r"^ *Candidate: (?!\(none\))", said, re.M) is not None


def left_out(what: str, packages: Iterable[str]) -> bool:
    """Says that ``what`` is left out for want of ``packages``. True: that is a failure."""
    missing = " ".join(packages)
    print(f"LEFT OUT: {what}; needs {missing} (sudo apt install {missing})", file=sys.stderr)
    fails = os.environ.get("CI", "").lower() in ("1", "true") and all(map(apt_offers, missing.split()))
    if fails:
        print(f"error: CI leaves nothing out that could be installed: {missing}", file=sys.stderr)
    return fails
