//! The order of the modules: each imports only from itself and from those before it.

use std::fs;
use std::path::{Path, PathBuf};

/// The top-level modules, in the order of the stages.
const ORDER: [&str; 12] = [
    "num",
    "curve",
    "noise",
    "scene",
    "field",
    "reference",
    "volume",
    "march",
    "formats",
    "report",
    "check",
    "cli",
];

/// Imports that the order alone would allow: the slow evaluator judges these modules, so it shares nothing with them.
const APART: [(&str, &str); 2] = [("reference", "field"), ("reference", "noise")];

/// Where the SIMD crate may be named: the lanes, and one file below `volume` that chooses the processor's level.
const SIMD: &str = "fearless_simd";
const LANES: &str = "num/real.rs";

#[test]
fn modules_import_only_from_those_before_them() {
    let faults: Vec<String> = sources().iter().flat_map(|(path, text)| faults(path, text)).collect();
    assert!(faults.is_empty(), "\n{}", faults.join("\n"));
}

#[test]
fn simd_is_named_by_the_lanes_and_one_dispatch() {
    let named: Vec<String> = sources()
        .into_iter()
        .filter(|(_, text)| tokens(text).iter().any(|token| token.text == SIMD))
        .map(|(path, _)| path)
        .filter(|path| path != LANES)
        .collect();
    assert!(named.len() <= 1 && named.iter().all(|path| path.starts_with("volume/")), "{named:?}");
}

#[test]
fn the_scan_sees_every_way_to_write_an_import() {
    for text in [
        "use crate::volume::Plan;",
        "use crate::volume;",
        "use crate::{num, volume::{Plan, Sink}};",
        "use crate::{num::Real,\n volume};",
        "use {crate::num, crate::volume};",
        "pub(crate) use crate :: volume as v;",
        "fn f() -> crate::volume::Plan { todo!() }",
        "use super::super::volume;",
        "use super::super::{num, volume};",
        "use super::{kernel, super::volume::Plan};",
        "mod tests { use super::super::super::volume; }",
        "mod tests { mod deep { fn f() { super::super::super::super::volume::plan() } } }",
        "use crate::*;",
        "const QUOTE: char = '\"'; use crate::volume; const OTHER: char = '\"';",
        "struct S<'a>(&'a str); use crate::volume; struct T<'a>(&'a str);",
        r###"const R: &str = r#"""#; use crate::volume; const Q: &str = r#"""#;"###,
    ] {
        assert_eq!(faults("field/tube.rs", text).len(), 1, "{text}");
    }
    for text in [
        "use crate::num::Real; use crate::{curve, scene::{Scene, Tube}};",
        "use super::span; use super::super::noise; pub(in crate::field) fn f() {}",
        "mod tests { use super::*; use super::super::*; use crate::curve::volume; }",
        "// crate::volume\n/* crate::volume /* crate::volume */ crate::volume */ /// [`crate::volume`]",
        r##"const A: &str = "crate::volume"; const B: &str = r#"crate::volume"#; const C: &str = "\"crate::volume";"##,
    ] {
        assert_eq!(faults("field/tube.rs", text), [""; 0], "{text}");
    }
    assert_eq!(
        faults("field/mod.rs", "use crate::num;\nuse super::volume;"),
        ["src/field/mod.rs:2: field imports volume, which comes after it"]
    );
    assert_eq!(faults("reference/mod.rs", "use crate::{noise, field};").len(), 2);
    assert_eq!(faults("cli/mod.rs", "use crate::nowhere;").len(), 1);
    assert_eq!(faults("nowhere/mod.rs", "").len(), 1);
}

/// Every source below a module's folder, by its path from `src/`, with `/` between names.
fn sources() -> Vec<(String, String)> {
    fn walk(folder: &Path, found: &mut Vec<PathBuf>) {
        for entry in fs::read_dir(folder).expect("a readable folder") {
            let path = entry.expect("a readable entry").path();
            if path.is_dir() {
                walk(&path, found);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                found.push(path);
            }
        }
    }
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut found = Vec::new();
    walk(&root, &mut found);
    found.sort();
    let sources: Vec<_> = found
        .iter()
        .map(|path| {
            let parts: Vec<_> = path
                .strip_prefix(&root)
                .expect("below src")
                .iter()
                .map(|part| part.to_string_lossy())
                .collect();
            (parts.join("/"), fs::read_to_string(path).expect("readable text"))
        })
        // These name the modules, and belong to none; the last is a package of its own.
        .filter(|(path, _)| path != "lib.rs" && path != "main.rs" && path != "heap/lib.rs")
        .collect();
    assert!(!sources.is_empty());
    sources
}

/// What a source imports against the order.
fn faults(path: &str, text: &str) -> Vec<String> {
    let place = |name: &str| ORDER.iter().position(|&module| module == name);
    let modules = module_path(path);
    let own = modules[0];
    let Some(own_place) = place(own) else {
        return vec![format!("src/{path}: the module {own} has no place in the order")];
    };
    imports(text, modules.len())
        .into_iter()
        .filter_map(|(line, name)| {
            let fault = match place(&name) {
                None => "which has no place in the order",
                Some(other) if other > own_place => "which comes after it",
                Some(_) if APART.contains(&(own, name.as_str())) => "from which it is kept apart",
                Some(_) => return None,
            };
            Some(format!("src/{path}:{line}: {own} imports {name}, {fault}"))
        })
        .collect()
}

/// The names of the modules that a file is in, outermost first.
fn module_path(path: &str) -> Vec<&str> {
    let stem = path.strip_suffix(".rs").unwrap_or(path);
    stem.strip_suffix("/mod").unwrap_or(stem).split('/').collect()
}

/// The names directly below the crate's root that a source mentions, with their lines. `depth` counts the modules that
/// the file is in.
fn imports(text: &str, depth: usize) -> Vec<(usize, String)> {
    let tokens = tokens(text);
    let mut found = Vec::new();
    // For every open brace, whether it opens a module.
    let mut braces = Vec::new();
    for (at, token) in tokens.iter().enumerate() {
        let before = at.checked_sub(1).map(|at| tokens[at].text);
        match token.text {
            "{" => braces.push(at >= 2 && tokens[at - 2].text == "mod"),
            "}" => drop(braces.pop()),
            // `pub(in crate::field)` imports nothing.
            "crate" if before != Some("in") => follow(&tokens, at + 1, 0, &mut found),
            // One that continues a path is met again here, and then leads less far.
            "super" => {
                let inside = depth + braces.iter().filter(|&&module| module).count();
                follow(&tokens, at + 1, inside - 1, &mut found);
            }
            _ => {}
        }
    }
    found
}

/// Follows a path from the `::` at `at`, in a module below `depth` others, and notes the names it reaches in the root.
fn follow(tokens: &[Token<'_>], at: usize, depth: usize, found: &mut Vec<(usize, String)>) {
    let text = |at: usize| tokens.get(at).map_or("", |token| token.text);
    if text(at) != "::" {
        return;
    }
    let mut item = |at: usize| match text(at) {
        "super" if depth > 0 => follow(tokens, at + 1, depth - 1, found),
        "" | "self" | "}" => {}
        name if depth == 0 => found.push((tokens[at].line, name.to_owned())),
        _ => {}
    };
    if text(at + 1) != "{" {
        return item(at + 1);
    }
    let mut open = 0;
    for at in at + 1..tokens.len() {
        match text(at) {
            "{" => open += 1,
            "}" => open -= 1,
            _ => {}
        }
        if open == 0 {
            break;
        }
        if open == 1 && matches!(text(at), "{" | ",") {
            item(at + 1);
        }
    }
}

struct Token<'a> {
    text: &'a str,
    line: usize,
}

/// Words, `::` and single marks, without comments, strings and characters.
fn tokens(source: &str) -> Vec<Token<'_>> {
    let word = |c: char| c.is_alphanumeric() || c == '_';
    let mut tokens = Vec::new();
    let (mut rest, mut line) = (source, 1);
    while let Some(first) = rest.chars().next() {
        let length = if rest.starts_with("//") {
            rest.find('\n').unwrap_or(rest.len())
        } else if rest.starts_with("/*") {
            comment_length(rest)
        } else if let Some(length) = string_length(rest) {
            length
        } else if first == '\'' {
            character_length(rest)
        } else if first.is_whitespace() {
            first.len_utf8()
        } else {
            let length = match rest {
                _ if word(first) => rest.find(|c| !word(c)).unwrap_or(rest.len()),
                _ if rest.starts_with("::") => 2,
                _ => first.len_utf8(),
            };
            tokens.push(Token { text: &rest[..length], line });
            length
        };
        line += rest[..length].matches('\n').count();
        rest = &rest[length..];
    }
    tokens
}

/// The length of a block comment, which may hold others.
fn comment_length(text: &str) -> usize {
    let mut open = 0;
    let mut at = 0;
    while at < text.len() {
        if text[at..].starts_with("/*") {
            (open, at) = (open + 1, at + 2);
        } else if text[at..].starts_with("*/") {
            (open, at) = (open - 1, at + 2);
        } else {
            at += text[at..].chars().next().map_or(1, char::len_utf8);
        }
        if open == 0 {
            break;
        }
    }
    at
}

/// The length of a string literal of any kind, if the text starts with one.
fn string_length(text: &str) -> Option<usize> {
    let body = text.trim_start_matches(['b', 'c']);
    let raw = body.strip_prefix('r').unwrap_or(body);
    let hashes = raw.len() - raw.trim_start_matches('#').len();
    if text.len() - raw.len() > 2 || !raw[hashes..].starts_with('"') {
        return None;
    }
    let start = text.len() - raw.len() + hashes + 1;
    if raw.len() < body.len() {
        let end = format!("\"{}", "#".repeat(hashes));
        return Some(text[start..].find(&end).map_or(text.len(), |at| start + at + end.len()));
    }
    if hashes > 0 {
        return None;
    }
    let mut escaped = false;
    for (at, c) in text[start..].char_indices() {
        match c {
            '"' if !escaped => return Some(start + at + 1),
            _ => escaped = c == '\\' && !escaped,
        }
    }
    Some(text.len())
}

/// The length of a character literal, or of a lifetime's mark.
fn character_length(text: &str) -> usize {
    let mut characters = text.char_indices().skip(1);
    match characters.next() {
        Some((_, '\\')) => text[3..].find('\'').map_or(text.len(), |at| 3 + at + 1),
        Some(_) => match characters.next() {
            Some((at, '\'')) => at + 1,
            _ => 1,
        },
        None => 1,
    }
}
