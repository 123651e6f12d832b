//! The import order of ARCHITECTURE.md holds in `src`, and the check that says so can fail.
//!
//! A module is a file or folder directly below `src`. Every `crate::…` and `super::…` path counts wherever it stands: in
//! a `use`, in an expression, in a type, and in test modules too, because a test that needs a higher module belongs to
//! that module. Comments (with the examples in them) and string literals do not count.

use std::fs;
use std::path::{Path, PathBuf};

/// Modules below the grid that everybody may see: random numbers and stop requests.
const LEAVES: &[&str] = &["progress", "random"];

/// The chain from the ground up; each sees all before it. The three of the second step do not see each other.
const CHAIN: &[&[&str]] = &[
    &["grid"],
    &["sensor", "terrain", "vehicle"],
    &["soil"],
    &["belief"],
    &["rank"],
    &["corridor"],
    &["nest"],
    &["swarm"],
    &["planner"],
];

/// What the core never does, as the paths and macros that would do it.
const FORBIDDEN_TO_THE_CORE: &[&[&str]] = &[
    &["std", "fs"],
    &["std", "net"],
    &["std", "env"],
    &["std", "process"],
    &["std", "time"],
    &["std", "io"],
    &["println", "!"],
    &["eprintln", "!"],
    &["print", "!"],
    &["eprint", "!"],
    &["dbg", "!"],
    &["static", "mut"],
];

/// The modules that `module` may see, or `None` for a module that the order does not know.
fn visible_from(module: &str) -> Option<Vec<&'static str>> {
    let with_leaves = |names: &[&'static str]| [LEAVES, names].concat();
    if LEAVES.contains(&module) {
        return Some(Vec::new());
    }
    if let Some(step) = CHAIN.iter().position(|names| names.contains(&module)) {
        return Some(with_leaves(&CHAIN[..step].concat()));
    }
    let chain = CHAIN.concat();
    match module {
        "local" => Some(with_leaves(&["grid", "sensor", "vehicle"])),
        "drive" => Some(with_leaves(&[chain.as_slice(), &["local"]].concat())),
        "sim" => Some(with_leaves(&["grid", "terrain", "soil", "vehicle", "sensor"])),
        "episode" => Some(with_leaves(&[chain.as_slice(), &["local", "drive", "sim"]].concat())),
        _ => None,
    }
}

/// Splits Rust source into identifiers, `::` and single signs, leaving out comments, literals and lifetimes.
fn tokens(source: &str) -> Vec<String> {
    let signs: Vec<char> = source.chars().collect();
    let starts = |at: usize, text: &str| {
        text.chars()
            .enumerate()
            .all(|(n, sign)| signs.get(at + n) == Some(&sign))
    };
    let mut found = Vec::new();
    let mut at = 0;
    while at < signs.len() {
        let sign = signs[at];
        if starts(at, "//") {
            while at < signs.len() && signs[at] != '\n' {
                at += 1;
            }
        } else if starts(at, "/*") {
            let mut depth = 0;
            loop {
                if starts(at, "/*") {
                    depth += 1;
                    at += 2;
                } else if starts(at, "*/") {
                    depth -= 1;
                    at += 2;
                } else {
                    at += 1;
                }
                if depth == 0 || at >= signs.len() {
                    break;
                }
            }
        } else if sign == '"' {
            at = after_string(&signs, at);
        } else if sign == '\'' {
            at = after_quote(&signs, at);
        } else if sign.is_alphanumeric() || sign == '_' {
            let from = at;
            while at < signs.len() && (signs[at].is_alphanumeric() || signs[at] == '_') {
                at += 1;
            }
            let word: String = signs[from..at].iter().collect();
            let hashes = signs[at..].iter().take_while(|&&next| next == '#').count();
            if matches!(word.as_str(), "r" | "br" | "cr") && signs.get(at + hashes) == Some(&'"') {
                at = after_raw_string(&signs, at + hashes + 1, hashes);
            } else if word == "r" && hashes == 1 {
                at += 1; // A raw identifier: the word itself follows.
            } else {
                found.push(word);
            }
        } else if starts(at, "::") {
            found.push("::".to_owned());
            at += 2;
        } else {
            if !sign.is_whitespace() {
                found.push(sign.to_string());
            }
            at += 1;
        }
    }
    found
}

/// The place after the string literal that opens at `at`.
fn after_string(signs: &[char], mut at: usize) -> usize {
    at += 1;
    while at < signs.len() && signs[at] != '"' {
        at += if signs[at] == '\\' { 2 } else { 1 };
    }
    at + 1
}

/// The place after the raw string literal whose text begins at `at` and which closes with `hashes` hash signs.
fn after_raw_string(signs: &[char], mut at: usize, hashes: usize) -> usize {
    while at < signs.len() {
        if signs[at] == '"' && signs[at + 1..].iter().take(hashes).filter(|&&sign| sign == '#').count() == hashes {
            return at + 1 + hashes;
        }
        at += 1;
    }
    at
}

/// The place after the quote at `at` and, for a character literal, after its closing quote; a lifetime has none.
fn after_quote(signs: &[char], at: usize) -> usize {
    if signs.get(at + 1) == Some(&'\\') {
        let closing = signs.iter().skip(at + 3).position(|&sign| sign == '\'');
        return closing.map_or(signs.len(), |distance| at + 3 + distance + 1);
    }
    if signs.get(at + 2) == Some(&'\'') {
        at + 3
    } else {
        at + 1
    }
}

/// The absolute paths (from the crate's root) that the source of the module `home` names.
fn absolute_paths(source: &str, home: &[String]) -> Vec<Vec<String>> {
    let tokens = tokens(source);
    let mut found = Vec::new();
    let mut here = home.to_vec();
    let mut inline_modules: Vec<usize> = Vec::new(); // Brace depth outside each inline module that is open.
    let mut depth = 0;
    for (at, token) in tokens.iter().enumerate() {
        match token.as_str() {
            "{" => {
                depth += 1;
                if at >= 2 && tokens[at - 2] == "mod" {
                    here.push(tokens[at - 1].clone());
                    inline_modules.push(depth - 1);
                }
            }
            "}" => {
                depth = usize::saturating_sub(depth, 1);
                if inline_modules.last() == Some(&depth) {
                    inline_modules.pop();
                    here.pop();
                }
            }
            "crate" | "super" | "self"
                if tokens.get(at + 1).is_some_and(|next| next == "::") && (at == 0 || tokens[at - 1] != "::") =>
            {
                follow(&tokens, at, &here, &[], &mut found);
            }
            // `pub(in crate::rank)` is a path like any other; `pub(crate)` and `use super as parent` name no module.
            _ => {}
        }
    }
    found
}

/// Collects the path, or the tree of paths in braces, that begins at `at`; returns the place after it.
fn follow(tokens: &[String], mut at: usize, here: &[String], prefix: &[String], found: &mut Vec<Vec<String>>) -> usize {
    let mut path = prefix.to_vec();
    loop {
        match tokens.get(at).map(String::as_str) {
            Some("crate") => path = Vec::new(),
            Some("self") if prefix.is_empty() && path.is_empty() => path = here.to_vec(),
            Some("self") => {}
            Some("super") => {
                if path.is_empty() {
                    path = here.to_vec();
                }
                path.pop();
            }
            Some("{") => {
                at += 1;
                while at < tokens.len() && tokens[at] != "}" {
                    at = if tokens[at] == "," {
                        at + 1
                    } else {
                        follow(tokens, at, here, &path, found)
                    };
                }
                return at + 1;
            }
            Some(name) => path.push(name.to_owned()),
            None => return at,
        }
        at += 1;
        if tokens.get(at).is_none_or(|next| next != "::") {
            break;
        }
        at += 1;
    }
    found.push(path);
    if tokens.get(at).is_some_and(|next| next == "as") {
        at + 2
    } else {
        at
    }
}

/// What is wrong in one source file: a sentence for each path that reaches where it may not.
fn complaints(file: &str, source: &str) -> Vec<String> {
    let home = module_path(file);
    let Some(module) = home.first() else {
        return Vec::new(); // lib.rs declares the modules and may name them all.
    };
    let Some(visible) = visible_from(module) else {
        return vec![format!(
            "{file}: the module `{module}` has no place in the import order; give it one here"
        )];
    };
    let mut found = Vec::new();
    for path in absolute_paths(source, &home) {
        match path.first() {
            None => found.push(format!("{file}: names the whole crate; name a module")),
            Some(seen) if seen == module || visible.contains(&seen.as_str()) => {}
            Some(seen) if visible_from(seen).is_some() => {
                found.push(format!(
                    "{file}: `{module}` must not see `{seen}` ({})",
                    path.join("::")
                ));
            }
            Some(seen) => found.push(format!(
                "{file}: `{seen}` is no module of the import order ({})",
                path.join("::")
            )),
        }
    }
    let tokens = tokens(source);
    for forbidden in FORBIDDEN_TO_THE_CORE {
        let words: Vec<&str> = tokens.iter().map(String::as_str).filter(|word| *word != "::").collect();
        if words.windows(forbidden.len()).any(|window| window == *forbidden) {
            found.push(format!("{file}: the core must not use {}", forbidden.join("::")));
        }
    }
    found
}

/// The module path of a file named relative to `src`: `rank.rs` and `rank/mod.rs` are `rank`, `rank/cost.rs` is below it.
fn module_path(file: &str) -> Vec<String> {
    let mut parts: Vec<String> = file.trim_end_matches(".rs").split('/').map(ToOwned::to_owned).collect();
    if parts
        .last()
        .is_some_and(|last| matches!(last.as_str(), "mod" | "lib" | "main"))
    {
        parts.pop();
    }
    parts
}

fn rust_files(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).expect("src can be listed") {
        let path = entry.expect("src can be listed").path();
        if path.is_dir() {
            found.extend(rust_files(&path));
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            found.push(path);
        }
    }
    found.sort();
    found
}

#[test]
fn every_module_sees_only_what_lies_below_it() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let files = rust_files(&root);
    assert!(files.len() > 1, "found no modules in {}", root.display());
    let mut found = Vec::new();
    for file in files {
        let name = file
            .strip_prefix(&root)
            .expect("below src")
            .to_string_lossy()
            .replace('\\', "/");
        found.extend(complaints(&name, &fs::read_to_string(&file).expect("source is text")));
    }
    assert!(found.is_empty(), "\n{}", found.join("\n"));
}

#[test]
fn what_is_allowed_passes() {
    let source = r##"
        //! Compare [`crate::planner`], which builds on this.
        use crate::grid::{Cell, GridGeometry as Geometry, steps::{self, Step}};
        use super::soil;
        /* crate::swarm /* crate::nest */ crate::drive */
        const TEXT: &str = "crate::swarm::run \" crate::nest";
        const RAW: &str = r#"crate::swarm"#;
        pub(crate) fn first<'a>(of: &'a [char]) -> bool { of[0] == '"' || of[0] == '\'' || crate::progress::stop() }
        mod tests { use super::*; use super::super::terrain::slope; use crate::random::Philox; }
    "##;
    assert_eq!(complaints("rank.rs", source), Vec::<String>::new());
    assert_eq!(complaints("rank/mod.rs", source), Vec::<String>::new());
    assert_eq!(
        complaints(
            "rank/cost.rs",
            "use super::reason::Reason; use super::super::soil::Soil;"
        ),
        Vec::<String>::new()
    );
    assert_eq!(
        complaints("lib.rs", "pub mod anything; pub use crate::planner::Route;"),
        Vec::<String>::new()
    );
    assert_eq!(
        complaints("episode.rs", "use crate::{drive, grid::Cell, local, sim};"),
        Vec::<String>::new()
    );
}

#[test]
fn what_is_wrong_is_found_wherever_it_stands() {
    for (file, source, seen) in [
        ("grid.rs", "use crate::rank::RankMap;", "rank"),
        ("rank.rs", "use crate::{grid::Cell, swarm::{Pellets, Swarm}};", "swarm"),
        ("rank.rs", "fn f(_: crate::nest::Nest) {}", "nest"),
        ("rank/cost.rs", "use super::super::planner;", "planner"),
        ("rank/cost.rs", "use super::super::{grid, planner::Route};", "planner"),
        ("rank.rs", "mod tests { use super::super::planner::Route; }", "planner"),
        (
            "rank.rs",
            "mod tests { fn f() {} } use super::planner::Route;",
            "planner",
        ),
        ("rank.rs", "use self::super::planner::Route;", "planner"),
        ("rank.rs", "pub(in crate::planner) fn f() {}", "planner"),
        ("rank.rs", "const A: &str = \"\"; use crate::r#drive::step;", "drive"),
        ("sensor.rs", "use crate::vehicle::Vehicle;", "vehicle"),
        ("local/vfh.rs", "use crate::terrain::slope;", "terrain"),
        ("sim.rs", "use crate::belief::SoilBelief;", "belief"),
        ("drive.rs", "use crate::sim::World;", "sim"),
        ("random.rs", "use crate::grid::Cell;", "grid"),
        ("progress.rs", "use crate::random::Philox;", "random"),
    ] {
        let found = complaints(file, source);
        let expected = format!("must not see `{seen}`");
        assert!(!found.is_empty(), "{file}: {source}");
        assert!(
            found.iter().all(|complaint| complaint.contains(&expected)),
            "{file}: {source}: {found:?}"
        );
    }
}

#[test]
fn an_unknown_module_is_named() {
    assert!(complaints("gadgets.rs", "")[0].contains("`gadgets` has no place"));
    assert!(complaints("rank.rs", "use crate::gadgets::Gadget;")[0].contains("`gadgets` is no module"));
    assert!(complaints("rank.rs", "use crate::*;")[0].contains("`*` is no module"));
}

#[test]
fn files_clocks_and_printing_are_found() {
    for source in [
        "use std::fs;",
        "fn f() { let t = std::time::Instant::now(); }",
        "fn f() { println!(\"{}\", 1); }",
        "static mut COUNT: u32 = 0;",
    ] {
        assert_eq!(complaints("rank.rs", source).len(), 1, "{source}");
    }
    assert_eq!(
        complaints("rank.rs", "// println!\nfn f() { let print = \"std::fs\"; }"),
        Vec::<String>::new()
    );
}
