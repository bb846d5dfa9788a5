//! What a baked file says of how it was made.

use serde::Serialize;
use sha2::{Digest, Sha256};
use uuid::Uuid;

use super::text::hexadecimal;
use crate::formats::vdb::{Compression, Meta, Metadata, Precision};
use crate::scene::{Antialias, Input};

/// The program and its version.
pub(super) const CREATOR: &str = concat!("vdbake ", env!("CARGO_PKG_VERSION"));

/// All settings that the bytes of a file depend on besides the scene's text, after defaults and overrides.
#[derive(Debug, Clone, Serialize)]
pub(super) struct Settings {
    pub(super) grids: [&'static str; 1],
    /// Metres.
    pub(super) voxel_size: f64,
    /// Seconds after the start frame.
    pub(super) time: f64,
    /// Of a sequence.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) frame: Option<i64>,
    pub(super) precision: &'static str,
    pub(super) compression: &'static str,
    pub(super) cutoff: f64,
    pub(super) octave_fade: bool,
    pub(super) widen: bool,
    pub(super) antialias: &'static str,
}

/// An anti-aliasing's word in a scene.
pub(super) fn antialias_name(antialias: Antialias) -> &'static str {
    match antialias {
        Antialias::Off => "off",
        Antialias::Adaptive => "adaptive",
    }
}

/// A compression's word on the command line.
pub(super) fn compression_name(compression: Compression) -> &'static str {
    match compression {
        Compression::Blosc => "blosc",
        Compression::Zip => "zip",
        Compression::None => "none",
    }
}

/// A precision's word on the command line.
pub(super) fn precision_name(precision: Precision) -> &'static str {
    match precision {
        Precision::F32 => "f32",
        Precision::F16 => "f16",
    }
}

/// From what, with which settings and by which version a file is made. The same recipe gives the same bytes.
#[derive(Debug, Clone)]
pub(super) struct Recipe {
    scene: String,
    settings: String,
    /// The scene's other files, where it names any.
    inputs: Option<String>,
}

/// A file that the scene names.
#[derive(Debug, Serialize)]
struct File<'a> {
    path: &'a str,
    sha256: String,
}

impl Recipe {
    pub(super) fn new(
        scene: &str,
        inputs: &[Input],
        settings: &Settings,
    ) -> Result<Recipe, serde_json::Error> {
        let files: Vec<File> = inputs
            .iter()
            .map(|Input { path, sha256, .. }| File { path, sha256: hexadecimal(sha256) })
            .collect();
        let inputs = if files.is_empty() { None } else { Some(serde_json::to_string(&files)?) };
        Ok(Recipe { scene: scene.to_owned(), settings: serde_json::to_string(settings)?, inputs })
    }

    /// A UUID of version 8 from the SHA-256 of version, settings, scene and its other files where there are any, each
    /// behind its length in bytes as a little-endian `u64`.
    pub(super) fn uuid(&self) -> Uuid {
        let mut hash = Sha256::new();
        let inputs = self.inputs.as_deref();
        for part in [CREATOR, &self.settings, &self.scene].into_iter().chain(inputs) {
            hash.update((part.len() as u64).to_le_bytes());
            hash.update(part);
        }
        let hash: [u8; 32] = hash.finalize().into();
        let mut bytes = [0; 16];
        bytes.copy_from_slice(&hash[..16]);
        uuid::Builder::from_custom_bytes(bytes).into_uuid()
    }

    /// The file's metadata. `content` is the hash of all values, in hexadecimal.
    pub(super) fn metadata(&self, content: &str) -> Metadata {
        [
            ("creator", CREATOR),
            ("vdbake_scene", &self.scene),
            ("vdbake_settings", &self.settings),
            ("vdbake_content_hash", content),
        ]
        .into_iter()
        .chain(self.inputs.as_deref().map(|inputs| ("vdbake_inputs", inputs)))
        .map(|(name, text)| (name.to_owned(), Meta::from(text)))
        .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settings() -> Settings {
        Settings {
            grids: ["density"],
            voxel_size: 0.1,
            time: 0.0,
            frame: None,
            precision: "f32",
            compression: "blosc",
            cutoff: 0.0,
            octave_fade: true,
            widen: true,
            antialias: "adaptive",
        }
    }

    #[test]
    fn settings_have_one_form() {
        let recipe = Recipe::new("", &[], &settings()).expect("settings");
        let expected = r#"{"grids":["density"],"voxel_size":0.1,"time":0.0,"precision":"f32","compression":"blosc","cutoff":0.0,"octave_fade":true,"widen":true,"antialias":"adaptive"}"#;
        assert_eq!(recipe.settings, expected);
        let frame = Recipe::new("", &[], &Settings { frame: Some(-7), ..settings() }).expect("settings");
        assert_eq!(frame.settings, expected.replace(r#""time":0.0,"#, r#""time":0.0,"frame":-7,"#));
    }

    #[test]
    fn uuid_tells_recipes_apart() {
        let uuid =
            |scene: &str, settings: &Settings| Recipe::new(scene, &[], settings).expect("settings").uuid();
        let other = Settings { time: 1.0, ..settings() };
        assert_eq!(uuid("a", &settings()), uuid("a", &settings()));
        assert_ne!(uuid("a", &settings()), uuid("b", &settings()));
        assert_ne!(uuid("a", &settings()), uuid("a", &other));
        let frame = Settings { frame: Some(1), ..settings() };
        assert_ne!(uuid("a", &settings()), uuid("a", &frame));
        assert_eq!(uuid("a", &settings()).get_version_num(), 8);
    }

    #[test]
    fn other_files_belong_to_the_recipe() {
        let input =
            |path: &str, byte| Input { path: path.to_owned(), sha256: [byte; 32], bytes: [byte].into() };
        let recipe = |inputs: &[Input]| Recipe::new("", inputs, &settings()).expect("settings");
        let one = recipe(&[input("a \"b\".csv", 10)]);
        let expected = format!(r#"[{{"path":"a \"b\".csv","sha256":"{}"}}]"#, "0a".repeat(32));
        assert_eq!(one.inputs.as_deref(), Some(expected.as_str()));
        assert!(one.metadata("").contains_key("vdbake_inputs"));
        assert!(!recipe(&[]).metadata("").contains_key("vdbake_inputs"));
        let uuids =
            [recipe(&[]), recipe(&[input("a", 1)]), recipe(&[input("a", 2)]), recipe(&[input("b", 1)])];
        let uuids: std::collections::BTreeSet<_> = uuids.iter().map(Recipe::uuid).collect();
        assert_eq!(uuids.len(), 4);
    }
}
