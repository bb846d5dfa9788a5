//! What others have to say of a scene, at its place in the text.

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;

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
        let places = self.places.get_or_init(|| Arc::new(Places::new(&self.text)));
        let fault = Fault::at(places.find(keys), title).label(label).note(help);
        let errors = SceneErrors::new(&self.origin, places.text.clone(), vec![fault.clone()], 0);
        // There, it knows its line and column.
        let fault = errors.faults().first().cloned().unwrap_or(fault);
        Remark { weight, fault, errors }
    }
}

/// Where the values of a text are. There may be many remarks on a long one: it is read once, and they share it.
#[derive(Debug)]
pub(crate) struct Places {
    text: Arc<str>,
    all: Place,
}

/// The bytes of a value, and what is in it.
#[derive(Debug)]
struct Place {
    span: Range<usize>,
    within: Within,
}

#[derive(Debug)]
enum Within {
    Nothing,
    Names(BTreeMap<String, Place>),
    Numbers(Vec<Place>),
}

impl Places {
    fn new(text: &str) -> Places {
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        let (document, _) = DeTable::parse_recoverable(text);
        // What is not given at all is on the first line.
        let span = 0..text.find('\n').unwrap_or(text.len());
        Places { text: text.into(), all: Place { span, within: Place::of_table(document.get_ref()) } }
    }

    /// The bytes of a value, or of the last on the way to it that is given.
    fn find(&self, keys: &[Key<'_>]) -> Range<usize> {
        let mut at = &self.all;
        for key in keys {
            let next = match (key, &at.within) {
                (Key::Name(name), Within::Names(names)) => names.get(*name),
                (Key::Number(number), Within::Numbers(numbers)) => numbers.get(*number),
                _ => None,
            };
            let Some(next) = next else { break };
            at = next;
        }
        at.span.clone()
    }
}

impl Place {
    fn new(value: &Spanned<DeValue<'_>>) -> Place {
        let within = match value.get_ref() {
            DeValue::Table(table) => Place::of_table(table),
            DeValue::Array(array) => Within::Numbers(array.iter().map(Place::new).collect()),
            _ => Within::Nothing,
        };
        Place { span: value.span(), within }
    }

    fn of_table(table: &DeTable<'_>) -> Within {
        Within::Names(
            table.iter().map(|(name, value)| (name.get_ref().to_string(), Place::new(value))).collect(),
        )
    }
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
