//! What others have to say of a scene, at its place in the text.

use std::ops::Range;

use annotate_snippets::Level;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::Scene;
use super::error::{Fault, SceneErrors};

/// A step on the way to a value of the text.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Key<'a> {
    /// A key of a table.
    Name(&'a str),
    /// An element of an array, counted from 0.
    Number(usize),
}

/// How much a remark matters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Weight {
    /// Good to know.
    Note,
    /// Hardly meant.
    Warning,
    /// What comes out is not what the text says.
    Serious,
}

/// A remark on a value of a scene's text.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Remark {
    weight: Weight,
    fault: Fault,
    errors: SceneErrors,
}

impl Remark {
    /// How much it matters.
    pub fn weight(&self) -> Weight {
        self.weight
    }

    /// The remark and its place.
    pub fn fault(&self) -> &Fault {
        &self.fault
    }

    /// The remark with its file, line, column and source line; with colours for a terminal.
    pub fn show(&self, coloured: bool) -> String {
        let level = match self.weight {
            Weight::Note => Level::NOTE,
            Weight::Warning => Level::WARNING,
            Weight::Serious => Level::ERROR.with_name("serious"),
        };
        self.errors.show(level, coloured)
    }
}

impl Scene {
    /// A remark on the value at the end of `keys`, or on what is given on the way to it. `title` is what is the matter,
    /// `label` stands beside the value, and `help` says what to change.
    pub fn remark(
        &self,
        weight: Weight,
        keys: &[Key<'_>],
        title: String,
        label: String,
        help: String,
    ) -> Remark {
        let text = self.text.strip_prefix('\u{feff}').unwrap_or(&self.text);
        let fault = Fault::at(locate(text, keys), title).label(label).note(help);
        let errors = SceneErrors::new(&self.origin, text, vec![fault.clone()], 0);
        // There, it knows its line and column.
        let fault = errors.faults().first().cloned().unwrap_or(fault);
        Remark { weight, fault, errors }
    }
}

/// The bytes of a value, or of the last on the way to it that is given.
fn locate(text: &str, keys: &[Key<'_>]) -> Range<usize> {
    let (document, _) = DeTable::parse_recoverable(text);
    let mut found = 0..text.find('\n').unwrap_or(text.len());
    let mut at: Option<&Spanned<DeValue<'_>>> = None;
    for key in keys {
        let next = match (key, at.map(Spanned::get_ref)) {
            (Key::Name(name), None) => document.get_ref().get(*name),
            (Key::Name(name), Some(DeValue::Table(table))) => table.get(*name),
            (Key::Number(number), Some(DeValue::Array(array))) => array.get(*number),
            _ => None,
        };
        let Some(value) = next else { break };
        found = value.span();
        at = next;
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "name = \"a\"\n[[tube]]\ncurve = { points = [[0,0,0],[1,0,0],[2,0,0]] }\n[[tube]]\n\
                        curve = { points = [[0,0,1],[1,0,0],[2,0,0]] }\nradius = 0.25\n[[tube.layer]]\noctaves = 3\n";

    fn place(keys: &[Key<'_>]) -> (usize, usize) {
        let scene = Scene::parse(TEXT, "scene.toml").unwrap_or_else(|errors| panic!("{errors}"));
        let remark = scene.remark(Weight::Note, keys, "what".into(), "this".into(), "help".into());
        (remark.fault().line(), remark.fault().column())
    }

    #[test]
    fn remarks_stand_at_the_value_or_above_it() {
        let tube = [Key::Name("tube"), Key::Number(1)];
        let key = |name| [tube.as_slice(), &[Key::Name(name)]].concat();
        assert_eq!(place(&key("radius")), (6, 10));
        assert_eq!(place(&[key("layer"), vec![Key::Number(0), Key::Name("octaves")]].concat()), (8, 11));
        // Not given: the table's own line.
        assert_eq!(place(&key("twist")).0, 4);
        assert_eq!(place(&[Key::Name("medium"), Key::Name("extinction")]), (1, 1));
    }
}
