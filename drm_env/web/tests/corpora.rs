//! The fuzzer's doors with their kept corpora and with damaged copies of them: what libFuzzer does for hours
//! (`make fuzz`), for a moment and always the same.

use std::fs;
use std::path::Path;

use drm_env::math::rng::{Purpose, Seed, Stream};

#[path = "../../fuzz/src/doors.rs"]
mod doors;

/// Damaged copies that each door is given, unless `DRM_FUZZ_CASES` says another number.
const CASES: usize = 300;

fn corpus(name: &str) -> Vec<Vec<u8>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../fuzz/corpus")
        .join(name);
    let entries = fs::read_dir(folder).expect("there is a corpus");
    let mut paths: Vec<_> = entries
        .map(|entry| entry.expect("it is readable").path())
        .collect();
    paths.sort();
    let read = |path| fs::read(path).expect("it is readable");
    paths.into_iter().map(read).collect()
}

/// A copy with some bytes changed, lost, doubled or taken from another one.
fn damaged(kept: &[Vec<u8>], random: &mut Stream) -> Vec<u8> {
    let mut found = kept[random.index(kept.len())].clone();
    for _ in 0..=random.index(4) {
        let place = random.index(found.len() + 1);
        match random.index(6) {
            0 if place < found.len() => found[place] ^= 1 << random.index(8),
            1 if place < found.len() => found[place] = random.index(256) as u8,
            2 => found.truncate(place),
            3 => found.insert(place, random.index(256) as u8),
            4 => {
                let part = found[place..(place + 9).min(found.len())].to_vec();
                found.splice(place..place, part);
            }
            _ => {
                let other = &kept[random.index(kept.len())];
                found.truncate(place);
                found.extend_from_slice(&other[place.min(other.len())..]);
            }
        }
    }
    found
}

fn try_out(name: &str) {
    let (_, door) = doors::DOORS
        .into_iter()
        .find(|(other, _)| *other == name)
        .expect("there is such a door");
    let kept = corpus(name);
    assert!(!kept.is_empty());
    let fed = |data: &[u8], what: &str| {
        let outcome = std::panic::catch_unwind(|| door(data));
        assert!(outcome.is_ok(), "{name}: {what}: {data:?}");
    };
    for data in [&[] as &[u8], &[0], &[255; 40]] {
        fed(data, "by hand");
    }
    for data in &kept {
        fed(data, "kept");
    }
    let cases = std::env::var("DRM_FUZZ_CASES").map_or(CASES, |text| {
        text.parse().expect("DRM_FUZZ_CASES is a number")
    });
    let mut random = Stream::new(Seed::from_u64(cases as u64), 0, Purpose::Sensors);
    for _ in 0..cases {
        fed(&damaged(&kept, &mut random), "damaged");
    }
}

#[test]
fn configurations_keep_their_promises() {
    try_out("configuration");
}

#[test]
fn texts_keep_their_promises() {
    try_out("text");
}

#[test]
fn snapshots_keep_their_promises() {
    try_out("snapshot");
}

#[test]
fn networks_keep_their_promises() {
    try_out("network");
}

#[test]
fn actions_keep_their_promises() {
    try_out("actions");
}

/// Whoever adds a door adds a corpus and a test here, and a target beside the doors.
#[test]
fn every_door_has_a_corpus_a_test_and_a_target() {
    let manifest = include_str!("../../fuzz/Cargo.toml");
    for (name, _) in doors::DOORS {
        assert!(include_str!("corpora.rs").contains(&format!("try_out(\"{name}\")")));
        assert!(manifest.contains(&format!("path = \"targets/{name}.rs\"")));
    }
}
