//! Dependencies go one way: each room of the engine knows only those below it, and no two files of a
//! room need each other. See docs/architecture.md.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// Rooms from the ground up.
const ROOMS: [&str; 20] = [
    "validity",
    "error",
    "check",
    "interruption",
    "memory",
    "simd",
    "math",
    "arm",
    "hardware",
    "control",
    "reference",
    "plant",
    "config",
    "simulation",
    "env",
    "render",
    "rollout",
    "batch",
    "analysis",
    "benchmark",
];

fn source() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("src")
}

/// Every source file as its module path, such as `env::reward`, with its text.
fn modules() -> BTreeMap<String, String> {
    let mut found = BTreeMap::new();
    let mut folders = vec![source()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).expect("the folder is readable") {
            let path = entry.expect("the entry is readable").path();
            if path.is_dir() {
                folders.push(path);
                continue;
            }
            // fonts, too, lie in the source tree
            if path.extension().is_none_or(|extension| extension != "rs") {
                continue;
            }
            let below = path.strip_prefix(source()).expect("it is below src");
            let mut parts: Vec<String> = below
                .with_extension("")
                .iter()
                .map(|part| part.to_string_lossy().into_owned())
                .collect();
            if parts.last().is_some_and(|last| last == "mod") {
                parts.pop();
            }
            let text = fs::read_to_string(&path).expect("the file is readable");
            found.insert(parts.join("::"), text);
        }
    }
    found
}

/// Paths below `crate::` that a file names outside comments, groups written out.
fn named(text: &str) -> BTreeSet<String> {
    let code: String = text
        .lines()
        .map(|line| line.split("//").next().unwrap_or_default())
        .collect::<Vec<_>>()
        .join("\n");
    let mut paths = BTreeSet::new();
    for rest in code.split("crate::").skip(1) {
        let end = rest
            .find(|c: char| !(c.is_alphanumeric() || c == '_' || c == ':'))
            .unwrap_or(rest.len());
        let head = rest[..end].trim_end_matches(':');
        paths.insert(head.to_owned());
        if let Some(group) = rest[end..].strip_prefix('{') {
            for item in group.split('}').next().unwrap_or_default().split(',') {
                let name = item.split_whitespace().next().unwrap_or_default();
                paths.insert(format!("{head}::{name}"));
            }
        }
    }
    paths
}

fn room(module: &str) -> &str {
    module.split("::").next().unwrap_or_default()
}

/// Arrows from rooms to rooms above them, as `file -> path`.
fn upward(modules: &BTreeMap<String, String>) -> Vec<String> {
    let floor = |name: &str| ROOMS.iter().position(|room| *room == name);
    let mut wrong = Vec::new();
    for (module, text) in modules.iter().filter(|(module, _)| *module != "lib") {
        let Some(own) = floor(room(module)) else {
            wrong.push(format!("{module} is in no room of the table"));
            continue;
        };
        for path in named(text) {
            if floor(room(&path)).is_some_and(|other| other > own) {
                wrong.push(format!("{module} -> {path}"));
            }
        }
    }
    wrong
}

/// Files that need each other, by way of others too.
fn circles(modules: &BTreeMap<String, String>) -> Vec<String> {
    // the longest module that a path begins with; a room's face (mod.rs) may show what is in the room
    let file_of = |path: &str| {
        let mut path = path;
        while !modules.contains_key(path) {
            path = path.rsplit_once("::")?.0;
        }
        Some(path.to_owned())
    };
    let arrows: BTreeMap<&String, BTreeSet<String>> = modules
        .iter()
        .map(|(module, text)| {
            let to = named(text).into_iter().filter_map(|path| file_of(&path));
            (module, to.filter(|to| to != module).collect())
        })
        .collect();
    let mut found = Vec::new();
    for module in modules.keys() {
        let (mut seen, mut next) = (BTreeSet::new(), vec![module.clone()]);
        while let Some(here) = next.pop() {
            for to in arrows.get(&here).into_iter().flatten() {
                if seen.insert(to.clone()) {
                    next.push(to.clone());
                }
            }
        }
        if seen.contains(module) {
            found.push(module.clone());
        }
    }
    found
}

#[test]
fn rooms_know_only_those_below_them() {
    let wrong = upward(&modules());
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn no_two_files_need_each_other() {
    let wrong = circles(&modules());
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn a_wrong_arrow_is_found() {
    let mut planted = modules();
    let text = planted.get_mut("arm").expect("there is an arm");
    text.push_str("\nuse crate::batch::Batch;\n");
    assert_eq!(upward(&planted), ["arm -> batch::Batch"]);
    assert!(circles(&planted).contains(&"arm".to_owned()));
}
