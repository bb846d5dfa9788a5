//! Texts that nobody meant to write.

use crate::scene::{Scene, SceneErrors};

const SCENES: [&str; 5] = [
    include_str!("../../../scenes/tornado.toml"),
    include_str!("../../../scenes/solar_flare.toml"),
    include_str!("../../../scenes/galaxy.toml"),
    include_str!("../../../scenes/figure2.toml"),
    include_str!("../../../scenes/sectors.toml"),
];

/// Bytes that mean something to the parser.
const MARKS: &[u8] = b"[]{}\"'=,.#\n\r\t -+_0159eaintx";

/// Sebastiano Vigna's splitmix64.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    fn below(&mut self, bound: usize) -> usize {
        usize::try_from(self.next() % bound as u64).unwrap()
    }
}

/// Asserts that every fault lies in the text and that all of them can be shown.
fn check(errors: &SceneErrors, text: &str) {
    let body = text.strip_prefix('\u{feff}').unwrap_or(text);
    let lines: Vec<_> = body.split('\n').collect();
    assert!(!errors.faults().is_empty() && errors.count() >= errors.faults().len());
    let mut before = (0, 0);
    for fault in errors.faults() {
        let at = (fault.line(), fault.column());
        assert!(before <= at, "faults are in order");
        before = at;
        // One past the last character is the place of what is missing at the end of a line.
        let line = lines.get(fault.line() - 1).expect("the line is in the text");
        assert!((1..=line.chars().count() + 1).contains(&fault.column()), "{at:?} of {text}");
        assert!(!fault.message().is_empty());
    }
    let shown = errors.to_string();
    assert!(
        shown.contains(&format!("scene.toml:{}:{}", before.0, before.1)),
        "{before:?} is not in\n{shown}"
    );
}

#[test]
fn mutated_scenes_are_valid_or_have_faults_in_place() {
    let mut random = Random(7);
    let mut faulty = 0;
    for round in 0..5000 {
        let mut bytes = SCENES[round % SCENES.len()].as_bytes().to_vec();
        for _ in 0..=random.below(4) {
            let at = random.below(bytes.len());
            match random.below(6) {
                0 => drop(bytes.remove(at)),
                1 => bytes[at] = random.next().to_le_bytes()[0],
                2 => bytes[at] = MARKS[random.below(MARKS.len())],
                3 => bytes.insert(at, MARKS[random.below(MARKS.len())]),
                4 => drop(bytes.drain(at..(at + random.below(60)).min(bytes.len()))),
                _ => {
                    let end = (at + random.below(60)).min(bytes.len());
                    let piece = bytes[at..end].to_vec();
                    let to = random.below(bytes.len());
                    bytes.splice(to..to, piece);
                }
            }
        }
        let text = String::from_utf8_lossy(&bytes);
        // Half of them at another time, where a valid scene may be faulty still.
        let seconds = if round % 2 == 0 { 0.0 } else { 0.75 };
        if let Err(errors) = Scene::parse_at(&text, "scene.toml", seconds) {
            check(&errors, &text);
            faulty += 1;
        }
    }
    // Changes that fall into comments, names and digits leave a scene valid; most others do not.
    assert!((1000..5000).contains(&faulty), "{faulty} of the texts are faulty");
}

#[test]
fn faults_beyond_a_hundred_are_counted() {
    let text = format!("[bake]\ngrids = [{}]\n", "1, ".repeat(3000));
    let errors = Scene::parse(&text, "scene.toml").unwrap_err();
    assert_eq!((errors.faults().len(), errors.count()), (100, 3000));
    assert!(errors.to_string().ends_with("\n\nand 2900 more errors"));
    check(&errors, &text.replace("more", ""));
}

#[test]
fn deep_nesting_is_one_error() {
    let text = format!("name = {}", "[".repeat(100_000));
    let errors = Scene::parse(&text, "scene.toml").unwrap_err();
    assert_eq!(errors.faults().len(), 1, "{errors}");
}

#[test]
fn stray_carriage_returns_end_a_line_like_any_other() {
    let text = "[bake]\ncutoff = 0\r\r\n";
    check(&Scene::parse(text, "scene.toml").unwrap_err(), text);
}

#[test]
fn long_words_are_cut() {
    let text = format!("{} = 1\nname = 2\n", "k".repeat(100_000));
    let errors = Scene::parse(&text, "scene.toml").unwrap_err();
    assert!(errors.faults()[0].message().len() < 200);
    check(&errors, &text);
}

#[test]
fn text_that_is_not_utf8() {
    let errors = SceneErrors::not_utf8("scene.toml", b"name = \"a\"\nfoo = \"\xe9t\xe9\"\n").unwrap();
    let expected = r#"
error: this file is not UTF-8 text
 --> scene.toml:2:8
  |
2 | foo = "�t�"
  |        ^ byte 19 of the file
  |
  = help: a scene is a TOML file, saved as UTF-8"#;
    assert_eq!(errors.to_string(), expected.trim_start());
    assert_eq!(SceneErrors::not_utf8("scene.toml", b"name = \"a\""), None);
}

#[test]
fn colours_are_only_added() {
    let errors = Scene::parse("nam = 1\n[bake]\nresolution = 0\n", "scene.toml").unwrap_err();
    let coloured = errors.to_coloured();
    let mut plain = String::new();
    for (index, piece) in coloured.split("\u{1b}[").enumerate() {
        plain.push_str(if index == 0 { piece } else { piece.split_once('m').unwrap().1 });
    }
    assert!(coloured.len() > plain.len());
    assert_eq!(plain, errors.to_string());
}
