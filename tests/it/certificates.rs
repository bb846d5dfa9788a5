//! Certificates that lie beside files, and files that carry none.

use serde_json::Value;
use uuid::Uuid;
use vdbake::formats::vdb::{
    self, FileHeader, GridClass, GridHeader, Meta, Metadata, VdbGridBuilder, VectorType,
};

use crate::cli::{Folder, code, errors, text};

fn bake(folder: &Folder, options: &[&str]) {
    let all = [&["bake", "bent.toml", "-o", "bent.vdb", "--quiet"][..], options].concat();
    assert_eq!(code(&folder.run(&all)), 0);
}

#[test]
fn a_bake_leaves_no_certificate_of_an_older_one() {
    let folder = Folder::new();
    bake(&folder, &["--certify"]);
    assert!(folder.made().contains(&"bent.certificate.json".to_owned()));
    bake(&folder, &["--resolution", "40"]);
    assert_eq!(folder.made(), ["bent.vdb"]);
    // What is none is somebody else's.
    folder.put("bent.certificate.json", "{}");
    bake(&folder, &[]);
    assert_eq!(folder.get("bent.certificate.json"), b"{}");
}

#[test]
fn a_certificate_of_another_file_is_noticed() {
    let folder = Folder::new();
    bake(&folder, &["--certify"]);
    let verify = || {
        let output = folder.run(&["verify", "bent.vdb", "--json"]);
        let report: Value = serde_json::from_slice(&output.stdout).expect("JSON");
        (code(&output), report["certificate_beside"]["fault"].clone(), report["certificate"].is_object())
    };
    assert_eq!(verify(), (0, Value::Null, true));
    let older = folder.get("bent.certificate.json");
    bake(&folder, &["--resolution", "40"]);
    assert_eq!(verify(), (0, Value::Null, false));
    folder.put("bent.certificate.json", &older);
    assert_eq!(verify(), (4, "it is of other values".into(), false));
    let told = text(&folder.run(&["verify", "bent.vdb"]));
    assert!(
        told.contains("bent.certificate.json does not belong to the file: it is of other values"),
        "{told}"
    );
    // Of the file's values, and alone: it is held against them, and what it states is found to be so or not.
    bake(&folder, &[]);
    folder.put("bent.certificate.json", &older);
    assert_eq!(verify(), (0, Value::Null, true));
    let better = String::from_utf8(older.clone()).expect("UTF-8").replacen("\"rms\": 0.", "\"rms\": 1.", 1);
    folder.put("bent.certificate.json", &better);
    assert_eq!(verify(), (4, Value::Null, true));
    let told = text(&folder.run(&["verify", "bent.vdb"]));
    assert!(told.lines().all(|line| line.len() < 120), "{told}");
    // Beside another in the file itself.
    bake(&folder, &["--certify"]);
    folder.put("bent.certificate.json", &better);
    assert_eq!(verify(), (4, "it says something else than that in the file".into(), true));
    folder.put("bent.certificate.json", "nothing");
    let (code, fault, _) = verify();
    assert!(
        code == 4 && fault.as_str().is_some_and(|fault| fault.starts_with("it makes no sense")),
        "{fault}"
    );
}

#[test]
fn files_by_others_are_said_to_be_theirs() {
    let folder = Folder::new();
    let header = GridHeader {
        name: "density".to_owned(),
        class: GridClass::FogVolume,
        vector_type: VectorType::Invariant,
        voxel_size: 1.0,
        translation: [0.5; 3],
        metadata: Metadata::new(),
    };
    let grid = VdbGridBuilder::<f32>::with_encoder(vdb::Encoder::new(vdb::Compression::None));
    for (creator, said) in
        [(None, "by this program\n"), (Some("Other 1.0"), "by this program, but by Other 1.0\n")]
    {
        let mut metadata = Metadata::new();
        if let Some(creator) = creator {
            metadata.insert("creator".to_owned(), Meta::from(creator));
        }
        let mut file = Vec::new();
        let around = FileHeader { uuid: Uuid::nil(), metadata };
        vdb::write(&mut file, &around, &[(&header, &grid)]).expect("written");
        folder.put("other.vdb", &file);
        let output = folder.run(&["verify", "other.vdb"]);
        let told = errors(&output);
        assert_eq!(code(&output), 3, "{told}");
        assert!(told.contains(said) && !told.contains("the file is by"), "{told}");
        assert!(told.contains("hint: `vdbake info` tells what is in it"), "{told}");
    }
}

#[test]
fn metadata_of_other_types_are_named() {
    let folder = Folder::new();
    bake(&folder, &["--certify"]);
    let bytes = folder.get("bent.vdb");
    for name in ["vdbake_certificate", "vdbake_settings", "vdbake_scene", "vdbake_content_hash"] {
        // A name is followed by its type, each behind its length.
        let entry = [name.as_bytes(), &6_u32.to_le_bytes(), b"string"].concat();
        let at = bytes.windows(entry.len()).position(|part| part == entry).expect("an entry");
        let mut other = bytes.clone();
        other[at + name.len() + 4..at + entry.len()].copy_from_slice(b"custom");
        folder.put("other.vdb", &other);
        let output = folder.run(&["verify", "other.vdb"]);
        let told = errors(&output);
        assert_eq!(code(&output), 3, "{told}");
        assert!(told.contains(&format!("{name} in other.vdb is not a text")), "{told}");
    }
}

#[test]
fn verify_asks_for_what_it_needs() {
    let folder = Folder::new();
    bake(&folder, &[]);
    let output = folder.run(&["verify", "bent.vdb", "--bricks", "0"]);
    assert_eq!(code(&output), 2);
    assert!(
        errors(&output).contains("a whole number of bricks of at least 1, or `all`"),
        "{}",
        errors(&output)
    );
    for (name, hint) in [
        ("bnet.vdb", "hint: there is a file bent.vdb"),
        ("nowhere/bent.vdb", "hint: there is no folder nowhere"),
        ("zzzz", "hint: names are relative to the current folder"),
    ] {
        let output = folder.run(&["verify", name]);
        let told = errors(&output);
        assert_eq!(code(&output), 3, "{told}");
        assert!(told.starts_with(&format!("error: cannot read {name}: ")) && told.contains(hint), "{told}");
    }
    let output = folder.run(&["bake", "bent.tml"]);
    assert!(errors(&output).contains("hint: there is a file bent.toml"), "{}", errors(&output));
}

#[test]
fn every_frame_tells_its_errors() {
    let folder = Folder::new();
    let bake = ["bake", "bent.toml", "-o", "a.##.vdb", "--frames", "1-3", "--certify", "--quiet"];
    let told = text(&folder.run(&bake));
    let measured: Vec<&str> = told.lines().filter(|line| line.contains("measured")).collect();
    assert_eq!(measured.len(), 3, "{told}");
    assert!(measured.iter().all(|line| line.contains("relative L2 0.") && line.contains("mass")), "{told}");
    let made = folder.made();
    assert_eq!(made.iter().filter(|name| name.ends_with(".certificate.json")).count(), 3, "{made:?}");
}

#[test]
fn reports_refuse_places_before_they_measure() {
    let folder = Folder::new();
    std::fs::create_dir(folder.path("x.csv")).expect("a folder");
    std::fs::create_dir(folder.path("y.json")).expect("a folder");
    for (output, said) in [
        ("x.csv", "x.csv is not a regular file"),
        ("nowhere/x.csv", "there is no folder nowhere"),
        ("y.html", "y.json is not a regular file"),
    ] {
        // A scene that there is none of: what is wrong with the place is known before it is read.
        let output = folder.run(&["report", "none.toml", "-o", output]);
        let told = errors(&output);
        assert_eq!(code(&output), 1, "{told}");
        assert!(told.contains(said), "{told}");
    }
    assert_eq!(folder.made(), ["x.csv", "y.json"]);
}
