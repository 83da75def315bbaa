# SPDX-License-Identifier: Apache-2.0
"""The page of the C++ interface: Doxygen reads the comments of the public headers, this file makes tables of them."""

import re
import shutil
import subprocess
import tempfile
import xml.etree.ElementTree as ElementTree
from pathlib import Path

SETTINGS = """
INPUT = {include}/cama
INCLUDE_PATH = {include} {include}/..
FILE_PATTERNS = *.hpp
STRIP_FROM_PATH = {include}
OUTPUT_DIRECTORY = {output}
GENERATE_XML = YES
GENERATE_HTML = NO
GENERATE_LATEX = NO
EXTRACT_ALL = YES
MACRO_EXPANSION = YES
JAVADOC_AUTOBRIEF = YES
AUTOLINK_SUPPORT = NO
SORT_MEMBER_DOCS = NO
QUIET = YES
WARN_IF_UNDOCUMENTED = NO
WARN_IF_DOC_ERROR = YES
"""
TABLES = {"Options": "options", "StepReport": "report"}  # structs made of a table that has a page of its own


def text(node):
    """All text below an XML element, in one line."""
    return " ".join("".join(node.itertext()).split()) if node is not None else ""


def prose(node):
    """Brief and detailed description as one line of Markdown; parameters as "name: meaning"."""
    parts = []
    for part in ("briefdescription", "detaileddescription"):
        element = node.find(part)
        if element is None:
            continue
        parameters = [
            f"`{text(item.find('parameternamelist'))}`: {plain(text(item.find('parameterdescription')))}"
            for item in element.iter("parameteritem")
        ]
        for paragraph in element.iter("para"):
            for below in paragraph.findall("parameterlist"):
                paragraph.remove(below)
        words = plain(text(element))
        parts += [words] if words else []
        parts += ["; ".join(parameters)] if parameters else []
    return " ".join(parts)


def plain(words):
    """Escapes what Markdown would read as markup."""
    for mark in "\\*_<>[]|`":
        words = words.replace(mark, "\\" + mark if mark not in "<>" else {"<": "&lt;", ">": "&gt;"}[mark])
    return words


def code(words):
    """A declaration as code in a table's cell, spaced as in the headers."""
    words = re.sub(r"\s*([&*]+)\s*", r" \1", words)  # const Scene &scene
    words = re.sub(r"\s*=\s*0$", "", words) if "(" in words else words  # a pure virtual function
    words = re.sub(r"(?<=\w)=(?=[\w{\"-])", " = ", words)  # n = 0
    words = words.replace("= default", "").replace("=default", "").replace("< ", "<").replace(" >", ">")
    return "`" + " ".join(words.split()).replace("|", "\\|") + "`"


def line_of(node):
    return int(node.find("location").get("line"))


def signature(member):
    """A declaration as it stands in the header, without its comment."""
    kind, name = member.get("kind"), text(member.find("name"))
    if kind == "enum":
        return f"enum class {name} {{ {', '.join(text(value.find('name')) for value in member.findall('enumvalue'))} }}"
    if kind == "typedef":
        return f"using {name} = {text(member.find('type'))}"
    type_, arguments, start = (
        text(member.find("type")),
        text(member.find("argsstring")),
        text(member.find("initializer")),
    )
    static = "static " if member.get("static") == "yes" and not type_.startswith("static") else ""
    return f"{static}{type_} {name}{arguments} {start}".strip()


def rows(members):
    """[(signatures, description)]. Variables of one line share its comment; so do functions below it."""
    result, last = [], None
    for member in sorted(members, key=line_of):
        words, line = prose(member), line_of(member)
        if member.get("kind") == "enum":
            values = [f"`{text(v.find('name'))}`: {prose(v)}" for v in member.findall("enumvalue") if prose(v)]
            words = " ".join([words, *values])
        free = "_1_1" not in member.get("id") and member.get("kind") == "function"
        if result and (line == last and not result[-1][1] or free and line - last == 1 and not words):
            result[-1] = [*result[-1][0], signature(member)], words or result[-1][1]
        else:
            result.append(([signature(member)], words))
        last = line
    return result


def table(members):
    return [
        "| declaration | meaning |",
        "|---|---|",
        *("| " + "<br>".join(map(code, names)) + f" | {words} |" for names, words in rows(members)),
    ]


def doxygen(include, output):
    """Runs Doxygen; the parsed compounds. Whatever it complains of ends the build."""
    if not shutil.which("doxygen"):
        raise SystemExit("docs/cpp_reference.py: the program doxygen was not found (Debian: apt install doxygen)")
    settings = Path(output) / "Doxyfile"
    settings.write_text(SETTINGS.format(include=include, output=output), encoding="utf-8")
    done = subprocess.run(["doxygen", str(settings)], capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"docs/cpp_reference.py: doxygen failed\n{done.stderr}")
    files = sorted(Path(output, "xml").glob("*.xml"))
    return [
        ElementTree.parse(file).getroot().find("compounddef")
        for file in files
        if file.stem not in ("index", "Doxyfile")
    ]


def page(include):
    """Markdown of all public headers below `include`."""
    with tempfile.TemporaryDirectory() as output:
        compounds = [c for c in doxygen(Path(include).resolve(), output) if c is not None]
    classes, free, heads = {}, {}, {}
    for compound in compounds:
        name, kind = text(compound.find("compoundname")), compound.get("kind")
        members = [
            m
            for section in compound.findall("sectiondef")
            for m in section.findall("memberdef")
            if m.get("prot") in ("public", None)
        ]
        if kind == "namespace" and name == "cama":
            for member in members:
                free.setdefault(Path(member.find("location").get("file")).name, []).append(member)
        elif kind in ("class", "struct") and name.startswith("cama::") and "kernels" not in name:
            header = Path(compound.find("location").get("file")).name
            classes.setdefault(header, []).append((line_of(compound), kind, name[6:], prose(compound), members))
        elif kind == "file":
            heads[name] = prose(compound)
    lines = [
        "# C++ interface",
        "",
        "The public headers, generated from their comments by Doxygen. Include `cama/simulation.hpp` to load a scene",
        "and step it; link with `cama::cama` (`find_package(cama)`,",
        "[install](../start/install.md#the-c-library)). Everything is in the namespace `cama`. Options and the report",
        "of a step have tables of their own: [options](options.md), [report](report.md).",
        "",
    ]
    for header in sorted({*classes, *free}):
        lines += [f"## cama/{header}", "", heads.get(header, ""), ""]
        for _, kind, name, words, members in sorted(classes.get(header, ()), key=lambda entry: entry[0]):
            lines += [f"### {kind} `{name}`", "", words, ""]
            if name in TABLES:
                lines += [f"Its members are those of the table of [{TABLES[name]}]({TABLES[name]}.md).", ""]
                members = [member for member in members if member.get("kind") == "function"]
            if members:
                lines += [*table(members), ""]
        if header in free:
            lines += ["### Functions and types", "", *table(free[header]), ""]
    return re.sub(r"\n{3,}", "\n\n", "\n".join(lines))
