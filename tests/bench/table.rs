//! Figures with names, as tables to read or as JSON.

use serde_json::{Map, Value};
use vdbake::num::Level;

/// A section of a bench: its name, and what measures it with these options.
pub(crate) type Section<O> = (&'static str, fn(&O) -> Table);

/// Measures the sections that are asked for, or all, and prints a table for each as it comes, or one JSON object in the end.
pub(crate) fn show<O>(sections: &[Section<O>], asked: &[String], options: &O, json: bool) {
    let mut object = Map::new();
    object.insert("simd".into(), Level::best().name().into());
    object.insert("threads".into(), rayon::current_num_threads().into());
    for (name, run) in sections {
        if !asked.is_empty() && asked.iter().all(|asked| asked != name) {
            continue;
        }
        let table = run(options);
        if json {
            object.insert((*name).into(), table.json());
        } else {
            println!("{name}, {}\n\n{}", Level::best().name(), table.text());
        }
    }
    if json {
        println!("{}", Value::Object(object));
    }
}

/// The value in the middle.
pub(crate) fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// Rows of figures under the same names.
pub(crate) struct Table {
    columns: &'static [&'static str],
    rows: Vec<Vec<Value>>,
}

impl Table {
    pub(crate) fn new(columns: &'static [&'static str]) -> Table {
        Table { columns, rows: vec![] }
    }

    /// Adds a row of as many values as there are columns.
    pub(crate) fn push(&mut self, row: Vec<Value>) {
        assert_eq!(row.len(), self.columns.len());
        self.rows.push(row);
    }

    /// An object for each row.
    pub(crate) fn json(&self) -> Value {
        let object = |row: &Vec<Value>| {
            let pairs = self.columns.iter().zip(row);
            Value::Object(pairs.map(|(name, value)| ((*name).into(), value.clone())).collect::<Map<_, _>>())
        };
        self.rows.iter().map(object).collect()
    }

    /// The columns side by side.
    pub(crate) fn text(&self) -> String {
        let mut lines = vec![self.columns.iter().map(|name| name.replace('_', " ")).collect::<Vec<_>>()];
        lines.extend(self.rows.iter().map(|row| row.iter().map(text).collect()));
        let width = |column: usize| lines.iter().map(|line| line[column].len()).max().unwrap_or(0);
        let widths: Vec<usize> = (0..self.columns.len()).map(width).collect();
        let mut out = String::new();
        for line in lines {
            for (value, width) in line.iter().zip(&widths) {
                out += &format!("{value:>width$}  ");
            }
            out += "\n";
        }
        out
    }
}

fn text(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Number(number) if number.is_u64() => number.to_string(),
        Value::Number(number) => number.as_f64().map_or("-".into(), |number| format!("{number:.3}")),
        _ => "-".into(),
    }
}
