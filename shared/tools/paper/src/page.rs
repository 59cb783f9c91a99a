//! Renders the page as HTML and as Markdown with the same content.

use super::section::{Check, Section, Table, Verdict};
use plot::escape;
use plot::page::html_table;
use std::fmt::Write as _;

const STYLE: &str = "body{font:16px/1.5 sans-serif;max-width:1060px;margin:2em auto;padding:0 1em;color:#222}\
h2{margin-top:2.5em;border-top:1px solid #ddd;padding-top:1em}img{max-width:100%}\
table{border-collapse:collapse;margin:1em 0}th,td{border:1px solid #ccc;padding:.2em .7em;text-align:right}\
th{background:#f4f4f4}td:first-child,th:first-child{text-align:left}caption{text-align:left;font-weight:bold}\
.verdict{display:inline-block;padding:.1em .7em;border-radius:.8em;color:#fff}\
.holds{background:#2c8c3c}.conditions{background:#c67c00}.not{background:#c03030}\
.yes{color:#2c8c3c}.no{color:#c03030}";

const TITLE: &str = "The paper, reproduced by this code";

const FOREWORD: &str = "Every figure and table of Borgstrom et al., \u{201c}Design and Implementation of NIMS3D, a 3-D Cabled Robot for Actuated Sensing Applications\u{201d}, \
IEEE Transactions on Robotics 25 (2), 2009, computed with the library and the control chain of the robot. The numbers in \
the tables of the printed paper were not available, so every configuration here is a substitute of the sizes that the text gives \
(spans of about 10 m, range errors of 1.5 mm, 43 points, a spiral of 1.125 m), and every number attributed to the paper is \
from its text. Figures 1, 2 and 9 are photographs and drawings. All random numbers are seeded: the same \
program writes the same page. Each verdict is computed from the statements listed below it.";

fn class(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Holds => "holds",
        Verdict::UnderConditions => "conditions",
        Verdict::DoesNotHold => "not",
    }
}

/// Returns the name of a plot's file without extension.
pub fn stem(section: &Section, picture: usize) -> String {
    if section.pictures.len() == 1 { section.key.to_owned() } else { format!("{}-{}", section.key, picture + 1) }
}

fn summary(sections: &[Section]) -> Table {
    let mut table = Table::new("Summary", &["", "verdict", "ratio to the paper's method"]);
    for section in sections {
        let ratio = section.ratio.clone().unwrap_or_default();
        table.row([section.title.to_owned(), Verdict::from_checks(&section.checks).text().to_owned(), ratio]);
    }
    table
}

/// Renders the page as HTML.
pub fn html(sections: &[Section]) -> String {
    let mut out = String::new();
    // Writing to a string cannot fail.
    let _ = write!(
        out,
        "<!DOCTYPE html>\n<html lang=\"en\">\n<meta charset=\"utf-8\">\n<title>{TITLE}</title>\n<style>{STYLE}</style>\n\
         <h1>{TITLE}</h1>\n<p>{}</p>\n",
        escape(FOREWORD)
    );
    out.push_str(&html_table(&summary(sections)));
    for section in sections {
        let verdict = Verdict::from_checks(&section.checks);
        let _ = writeln!(out, "<h2 id=\"{}\">{}</h2>", section.key, escape(section.title));
        let _ = writeln!(out, "<p><b>{}.</b> {}</p>", claim_word(section), escape(&section.claim));
        let _ = writeln!(out, "<p><b>Setup.</b> {}</p>", escape(&capital(&section.stand_in)));
        for picture in 0..section.pictures.len() {
            let name = stem(section, picture);
            let _ = writeln!(
                out,
                "<p><a href=\"{name}.svg\"><img src=\"{name}.png\" alt=\"{}\"></a></p>",
                escape(section.title)
            );
        }
        for table in &section.tables {
            out.push_str(&html_table(table));
        }
        let _ = writeln!(out, "<p><span class=\"verdict {}\">{}</span></p>\n<ul>", class(verdict), verdict.text());
        for check in &section.checks {
            let (class, mark) = if check.held { ("yes", "\u{2713}") } else { ("no", "\u{2717}") };
            let _ = writeln!(out, "<li><b class=\"{class}\">{mark}</b> {}</li>", escape(&check.statement));
        }
        out.push_str("</ul>\n");
        if let Some(ratio) = &section.ratio {
            let _ = writeln!(out, "<p><b>Ratio to the paper's method:</b> {}</p>", escape(ratio));
        }
        for remark in &section.remarks {
            let _ = writeln!(out, "<p>{}</p>", escape(remark));
        }
    }
    out.push_str("</html>\n");
    out
}

/// Capitalises the first letter.
fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or(String::new(), |first| first.to_uppercase().chain(letters).collect())
}

fn claim_word(section: &Section) -> &'static str {
    if section.ratio.is_some() { "Idea" } else { "Claim" }
}

/// Renders the page as Markdown.
pub fn markdown(sections: &[Section]) -> String {
    let mut out = format!("# {TITLE}\n\n{FOREWORD}\n\n");
    out.push_str(&markdown_table(&summary(sections)));
    for section in sections {
        let verdict = Verdict::from_checks(&section.checks);
        let _ = write!(out, "\n## {}\n\n", section.title);
        let _ = write!(out, "**{}.** {}\n\n", claim_word(section), section.claim);
        let _ = write!(out, "**Setup.** {}\n\n", capital(&section.stand_in));
        for picture in 0..section.pictures.len() {
            let _ = write!(out, "![{}]({}.svg)\n\n", section.title, stem(section, picture));
        }
        for table in &section.tables {
            out.push_str(&markdown_table(table));
            out.push('\n');
        }
        let _ = write!(out, "**Verdict: {}.**\n\n", verdict.text());
        for Check { statement, held, .. } in &section.checks {
            let _ = writeln!(out, "* {} {statement}", if *held { "yes:" } else { "no:" });
        }
        if let Some(ratio) = &section.ratio {
            let _ = write!(out, "\n**Ratio to the paper's method:** {ratio}\n");
        }
        for remark in &section.remarks {
            let _ = write!(out, "\n{remark}\n");
        }
    }
    out
}

fn markdown_table(table: &Table) -> String {
    let mut out = format!("{}:\n\n", table.caption);
    let row = |cells: &[String]| {
        let cells: Vec<String> = cells.iter().map(|cell| cell.replace('|', "\\|")).collect();
        format!("| {} |\n", cells.join(" | "))
    };
    out.push_str(&row(&table.head));
    out.push_str(&row(&vec!["---".to_owned(); table.head.len()]));
    for cells in &table.rows {
        out.push_str(&row(cells));
    }
    out
}
