//! What a file's metadata say of how it was made, as `verify`, `info` and `render` read it.

use vdbake::formats::vdb::{
    Compression, EncodedBricks, FileHeader, GridClass, GridHeader, Meta, Metadata, VdbGridBuilder,
    VectorType, write,
};

use super::program::done;

/// The entries, in the order of the texts; there is none where a text is empty.
const ENTRIES: [&str; 3] = ["vdbake_settings", "vdbake_scene", "vdbake_inputs"];
/// Exit code where what was checked does not hold.
const CHECK: u8 = 4;
/// Stands between two texts; no UTF-8 text has it.
const BETWEEN: u8 = 0xff;

pub(crate) fn run(data: &[u8]) -> bool {
    let mut metadata: Metadata = ENTRIES
        .iter()
        .zip(data.split(|byte| *byte == BETWEEN))
        .filter(|(_, text)| !text.is_empty())
        .map(|(name, text)| ((*name).to_owned(), Meta::String(String::from_utf8_lossy(text).into_owned())))
        .collect();
    metadata.insert("vdbake_content_hash".to_owned(), Meta::from("0"));
    let file = file(metadata);
    assert_eq!(done(&["info", "in.vdb", "--json"], &file), 0);
    done(&["render", "in.vdb", "-o", "out.png", "--size", "4x4"], &file);
    // The brick is not what any recipe makes, which is only found where the recipe is read.
    let code = done(&["verify", "in.vdb", "--bricks", "2"], &file);
    assert_ne!(code, 0);
    code == CHECK
}

/// A density of one brick.
fn file(metadata: Metadata) -> Vec<u8> {
    let mut grid = VdbGridBuilder::new(Compression::Blosc);
    let mut run = EncodedBricks::default();
    run.push(grid.encoder(), [0; 3], &[u64::MAX; 8], &[0.5; 512]);
    grid.append(&run).expect("one brick");
    let header = GridHeader {
        name: "density".to_owned(),
        class: GridClass::FogVolume,
        vector_type: VectorType::Invariant,
        voxel_size: 0.125,
        translation: [0.0; 3],
        metadata: Metadata::new(),
    };
    let mut bytes = vec![];
    write(&mut bytes, &FileHeader { uuid: uuid::Uuid::nil(), metadata }, &[(&header, &grid)])
        .expect("a valid grid");
    bytes
}
