"""Rules of the house that no linter knows, each with a case that breaks it."""

from __future__ import annotations

import ast
import re
import shutil
import subprocess
import tomllib
from functools import cache
from pathlib import Path

import pytest

import requirement

ROOT = requirement.ROOT
LONGEST_FILE_LINES = 600
NAMES_THAT_SAY_NOTHING = frozenset({"utils", "util", "helpers", "common", "misc", "core", "types"})
# The compiled half of the package; the underscore says that nobody else uses it.
EXEMPT_NAMES = frozenset({"_core"})
SOURCE_SUFFIXES = frozenset({".css", ".html", ".js", ".py", ".rs", ".sh", ".sql", ".ts"})
# Cargo writes the address of its index into its lock file, and nothing can be done about it.
ADDRESSED_LOCKS = frozenset({"Cargo.lock"})
HOSTS_AND_MACHINE_PATHS = re.compile(
    r"(?:pypi\.org|pythonhosted\.org|npmjs\.(?:org|com)|(?:static|index)\.crates\.io|deb\.debian\.org)"
    r"|(?<![\w.~-])/(?:work|root|home/\w+|Users/\w+)/"
)


@cache
def repository_files() -> tuple[str, ...]:
    """Every file that is in the repository or about to be, named from the root."""
    git = shutil.which("git")
    if git is None or not (ROOT / ".git").exists():
        requirement.skip_or_fail("git", "This is not a git clone.", "Clone the repository to check its files.")
    command = [git, "-C", str(ROOT), "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(command, capture_output=True, check=True).stdout.decode()
    return tuple(sorted(name for name in set(listed.split("\0")) if name and (ROOT / name).is_file()))


def text_of(name: str) -> str | None:
    """The text of a file, or None when it holds something else."""
    try:
        return (ROOT / name).read_text(encoding="utf-8")
    except UnicodeDecodeError:
        return None


def too_long(name: str, text: str) -> str | None:
    lines = text.splitlines()
    if Path(name).suffix not in SOURCE_SUFFIXES or len(lines) <= LONGEST_FILE_LINES:
        return None
    if any("Why this file is long:" in line for line in lines[:20]):
        return None
    return f"{name} has {len(lines)} lines; split it, or say at its top `Why this file is long: ...`"


def says_nothing(name: str) -> str | None:
    path = Path(name)
    if path.suffix not in SOURCE_SUFFIXES:
        return None
    for part in (*path.parent.parts, path.stem):
        if part not in EXEMPT_NAMES and part.lstrip("_") in NAMES_THAT_SAY_NOTHING:
            return f"{name}: `{part}` says nothing; name it after its subject"
    return None


def names_a_host_or_machine(name: str, text: str) -> str | None:
    found = HOSTS_AND_MACHINE_PATHS.search(text)
    return f"{name} names {found.group()}" if found and name not in ADDRESSED_LOCKS else None


def make_targets(text: str) -> set[str]:
    return {target for line in re.findall(r"^([a-z][a-z -]*):(?!=)", text, re.MULTILINE) for target in line.split()}


def targets_named_in(text: str) -> set[str]:
    """The targets of `make ...` commands in code marks and code blocks; variables (NAME=value) are not targets."""
    code = re.findall(r"`([^`\n]+)`|^ {4}(.+)$", text, re.MULTILINE)
    lines = [line for pair in code for line in pair]
    lines += [
        line
        for block in re.findall(r"^```\w*\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
        for line in block.splitlines()
    ]
    commands = [found.group(1) for line in lines if (found := re.match(r"\s*(?:\$ )?make((?: [\w=./\"-]+)+)", line))]
    return {word for command in commands for word in command.split() if "=" not in word and not word.endswith('"')}


def dead_links(name: str, text: str) -> list[str]:
    """Relative links of a Markdown file that lead nowhere."""
    targets = re.findall(r"\]\(([^)#\s]+)[^)]*\)", text)
    return [
        f"{name} -> {target}"
        for target in targets
        if "://" not in target
        and not target.startswith("mailto:")
        and not (ROOT / name).parent.joinpath(target).exists()
    ]


def test_no_file_is_long_without_a_reason() -> None:
    found = [too_long(name, text) for name in repository_files() if (text := text_of(name)) is not None]
    assert [complaint for complaint in found if complaint] == []


def test_a_long_file_is_found_unless_it_says_why() -> None:
    assert too_long("a.py", "x = 1\n" * 600) is None
    assert "601 lines" in (too_long("a.py", "x = 1\n" * 601) or "")
    assert too_long("a.py", "# Why this file is long: it is one table.\n" + "x = 1\n" * 601) is None


def test_every_module_has_a_name_that_says_something() -> None:
    assert [complaint for complaint in map(says_nothing, repository_files()) if complaint] == []


@pytest.mark.parametrize(
    ("name", "wrong"),
    [
        ("python/swathe/utils.py", True),
        ("python/swathe/io/_helpers.py", True),
        ("crates/swathe/src/common/mod.rs", True),
        ("python/swathe/core.py", True),
        ("python/swathe/_core.py", False),
        ("python/swathe/rank.py", False),
        ("docs/types.md", False),
    ],
)
def test_a_name_that_says_nothing_is_found(name: str, wrong: bool) -> None:
    assert (says_nothing(name) is not None) is wrong


def test_no_file_names_a_registry_host_or_a_machines_path() -> None:
    found = [names_a_host_or_machine(name, text) for name in repository_files() if (text := text_of(name)) is not None]
    assert [complaint for complaint in found if complaint] == []


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        ("see @work@main", True),
        ("open('@home@ada@dem.tif')", True),
        ("https://files~pythonhosted~org/x", True),
        ("path/work/here and 1/root/2", False),
        ("the PyPI package", False),
    ],
)
def test_a_host_or_path_is_found(text: str, wrong: bool) -> None:
    text = text.replace("@", "/").replace("~", ".")  # written so that this file itself is clean
    assert (names_a_host_or_machine("a.md", text) is not None) is wrong
    assert names_a_host_or_machine("Cargo.lock", text) is None


def test_lock_files_have_hashes_and_no_addresses() -> None:
    locks = [
        name for name in repository_files() if re.fullmatch(r"requirements/.*\.txt|(.*/)?package-lock\.json", name)
    ]
    assert {"requirements/dev.txt", "requirements/runtime.txt", "requirements/uv.txt"} <= set(locks)
    for name in locks:
        text = text_of(name) or ""
        assert "://" not in text, name
        if name.endswith(".txt"):
            pins = re.split(r"\n(?=\S)", text.strip())
            assert [pin for pin in pins if "==" not in pin or "--hash=sha256:" not in pin] == [], name
    assert not [name for name in repository_files() if Path(name).name == "uv.lock"], "uv.lock holds addresses"


def test_the_locks_cover_what_the_project_asks_for() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    runtime = project["project"]["dependencies"]
    for lock, wanted in (
        ("runtime", runtime),
        ("dev", [*runtime, *project["dependency-groups"]["dev"]]),
    ):
        locked = set(re.findall(r"^([\w-]+)==", text_of(f"requirements/{lock}.txt") or "", re.MULTILINE))
        missing = {re.split(r"[^\w-]", name)[0].lower() for name in wanted} - locked
        assert missing == set(), f"run `make lock`: requirements/{lock}.txt lacks {sorted(missing)}"


def test_every_python_module_begins_with_what_it_is_for() -> None:
    modules = [name for name in repository_files() if name.startswith("python/swathe/") and name.endswith(".py")]
    assert len(modules) > 2
    silent = [name for name in modules if not ast.get_docstring(ast.parse(text_of(name) or ""))]
    assert silent == []


def test_the_version_stands_in_one_place() -> None:
    cargo = tomllib.loads((ROOT / "Cargo.toml").read_text(encoding="utf-8"))
    version = cargo["workspace"]["package"]["version"]
    for member in cargo["workspace"]["members"]:
        crate = tomllib.loads((ROOT / member / "Cargo.toml").read_text(encoding="utf-8"))
        assert crate["package"]["version"] == {"workspace": True}, member
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert "version" not in project
    assert "version" in project["dynamic"]
    code = [
        name for name in repository_files() if name.startswith(("python/", "crates/")) and name.endswith((".py", ".rs"))
    ]
    assert [name for name in code if f'"{version}"' in (text_of(name) or "")] == []
    assert f"## [{version}]" in (text_of("CHANGELOG.md") or "")


def test_the_licence_is_apache_2() -> None:
    text = text_of("LICENSE") or ""
    assert text.split()[:6] == ["Apache", "License", "Version", "2.0,", "January", "2004"]
    assert "END OF TERMS AND CONDITIONS" in text
    assert len(text.splitlines()) > 190
    cargo = tomllib.loads((ROOT / "Cargo.toml").read_text(encoding="utf-8"))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert cargo["workspace"]["package"]["license"] == project["license"] == "Apache-2.0"


def test_every_target_that_the_documents_name_exists() -> None:
    targets = make_targets(text_of("Makefile") or "")
    assert {"demo", "test", "bench", "lint", "fmt", "build", "lock", "clean"} <= targets
    documents = [name for name in repository_files() if name.endswith(".md")]
    named = {(name, target) for name in documents for target in targets_named_in(text_of(name) or "")}
    assert ("CONTRIBUTING.md", "test") in named
    assert sorted(pair for pair in named if pair[1] not in targets) == []


def test_targets_are_read_from_commands_only() -> None:
    text = "Run `make lint fmt`, then\n\n    make test A=x\n\nand\nmake sure of it.\n```sh\nmake bench B=y\n```\n"
    assert targets_named_in("`make sure`") == {"sure"}
    assert targets_named_in(text) == {"lint", "fmt", "test", "bench"}
    assert make_targets("build: x ## y\nlint test: build\nNAME := 1\n\techo a:\n") == {"build", "lint", "test"}


def test_links_between_documents_lead_somewhere() -> None:
    documents = [name for name in repository_files() if name.endswith(".md")]
    assert [link for name in documents for link in dead_links(name, text_of(name) or "")] == []


def test_a_dead_link_is_found() -> None:
    text = "[a](LICENSE) [b](no/such/page.md) [c](https://example.org) [d](#part) [e](Makefile#test)"
    assert dead_links("README.md", text) == ["README.md -> no/such/page.md"]
