//! `docs/tuning.md` has the table of the parameters that `nims set` changes, as the sections define them.
#![allow(clippy::unwrap_used)]

use std::fmt::Write;
use std::path::Path;

const HEAD: &str = "| parameter | accepted | default | what |\n|---|---|---|---|\n";

fn table() -> String {
    config::tunable().fold(HEAD.to_owned(), |mut text, one| {
        let default = if one.default.is_empty() { "none" } else { &one.default };
        writeln!(text, "| `{}` | {} | {default} | {} |", one.key, one.accepted, one.what).unwrap();
        text
    })
}

/// With `NIMS_RENEW=1` the test writes the table instead.
#[test]
fn the_page_has_the_table_of_the_sections() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../docs/tuning.md");
    let page = std::fs::read_to_string(&path).unwrap();
    let start = page.find("| parameter |").unwrap();
    let end = start + page[start..].find("\n\n").unwrap() + 1;
    let renewed = format!("{}{}{}", &page[..start], table(), &page[end..]);
    if std::env::var_os("NIMS_RENEW").is_some_and(|value| value == "1") {
        std::fs::write(&path, renewed).unwrap();
        return;
    }
    let renew = "NIMS_RENEW=1 cargo test -p config --test tuning_page";
    assert!(page == renewed, "the table in docs/tuning.md is not that of the sections; write it again: {renew}");
}
