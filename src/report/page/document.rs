//! A page as such: one HTML file without scripts.

use maud::{DOCTYPE, Markup, PreEscaped, html};

/// A part of a page.
#[derive(Debug, Clone)]
pub struct Section {
    title: String,
    body: Markup,
}

impl Section {
    /// A part with a title.
    pub fn new(title: impl Into<String>, body: Markup) -> Section {
        Section { title: title.into(), body }
    }
}

/// A page of sections. `title` is the window's, `heading` the page's own, with a sentence below it.
pub fn document(title: &str, heading: &str, lead: &str, sections: &[Section]) -> String {
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta name="color-scheme" content="light dark";
                title { (title) }
                style { (PreEscaped(STYLE)) }
            }
            body {
                header {
                    h1 { (heading) }
                    p.lead { (lead) }
                }
                main {
                    @for part in sections { section { h2 { (part.title) } (part.body) } }
                }
            }
        }
    };
    page.into_string()
}

const STYLE: &str = include_str!("style.css");
