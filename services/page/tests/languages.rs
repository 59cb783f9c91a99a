//! The languages of the page are complete: every label, every reason of the catalogue of answers with its parameters,
//! and every sentence of the guided calibration.

#![allow(clippy::unwrap_used, clippy::panic)]

use config::DriveProtocol;
use robot_state::answers::CATALOGUE;
use robot_state::sentences;
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

const LANGUAGES: [&str; 3] = ["de", "es", "fr"];

fn sources() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("web/src")
}

/// A sentence with the names of its parameters alone; those without a name are counted from 1.
fn template(text: &str) -> String {
    let (mut made, mut rest, mut unnamed) = (String::new(), text, 0);
    while let Some((before, inside)) = rest.split_once('{') {
        let (parameter, after) = inside.split_once('}').unwrap();
        let name = parameter.split(':').next().unwrap();
        if name.is_empty() {
            unnamed += 1;
        }
        let name = if name.is_empty() { unnamed.to_string() } else { name.to_owned() };
        made.push_str(&format!("{before}{{{name}}}"));
        rest = after;
    }
    made + rest
}

fn parameters(text: &str) -> BTreeSet<&str> {
    text.split('{').skip(1).filter_map(|inside| Some(inside.split_once('}')?.0)).collect()
}

/// The English sentences by their numbers, as the page compares them with what comes.
fn templates() -> BTreeMap<u16, String> {
    CATALOGUE.iter().map(|(code, _, text)| (*code, template(text))).collect()
}

#[test]
fn the_page_has_the_sentences_of_the_catalogue() {
    let path = sources().join("lang/reasons.json");
    let rows: Vec<String> =
        templates().iter().map(|(code, text)| format!("  \"{code}\": {}", Value::from(text.as_str()))).collect();
    let text = format!("{{\n{}\n}}\n", rows.join(",\n"));
    if std::env::var_os("NIMS_RENEW").is_some() {
        std::fs::write(&path, &text).unwrap();
    }
    let kept = std::fs::read_to_string(&path).unwrap();
    assert!(kept == text, "{} is of another catalogue: run this test with NIMS_RENEW=1", path.display());
}

/// The labels of the page: each `t("…")`.
fn labels() -> BTreeSet<String> {
    let mut labels = BTreeSet::new();
    for entry in std::fs::read_dir(sources()).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|ending| ending == "ts") {
            let text = std::fs::read_to_string(&path).unwrap();
            for (at, _) in text.match_indices("t(\"") {
                let begins = text[..at].chars().last().is_none_or(|before| !before.is_alphanumeric());
                let label = text[at + 3..].split('"').next().unwrap();
                if begins {
                    labels.insert(label.to_owned());
                }
            }
        }
    }
    labels
}

/// Where the guided calibration says something: in `say!("…")`.
const GUIDE: [&str; 3] = ["../../shared/tools/site-calibration/src", "../../shared/robot/calibration/src", "src"];

/// The sentences of the guided calibration.
fn guide() -> BTreeSet<String> {
    let mut sentences = BTreeSet::new();
    let mut folders: Vec<_> = GUIDE.iter().map(|at| Path::new(env!("CARGO_MANIFEST_DIR")).join(at)).collect();
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|ending| ending == "rs") {
                let text = std::fs::read_to_string(&path).unwrap();
                sentences.extend(text.split("say!(").skip(1).filter_map(|rest| literal(rest.trim_start())));
            }
        }
    }
    let drives = DriveProtocol::ALL.iter().flat_map(|protocol| {
        let family = protocol.family();
        [family.set, family.remedies.silent]
    });
    sentences.iter().map(|text| template(text)).chain(drives.map(str::to_owned)).collect()
}

/// Where it is said why something cannot be done: in errors, and in what is written from parts.
const WHY: [&str; 13] = [
    "services/page/src/scene.rs",
    "services/page/src/session.rs",
    "services/planner/src/plan/builder.rs",
    "services/planner/src/scan.rs",
    "shared/robot/cable-robot/src/energy/error.rs",
    "shared/robot/cable-robot/src/kinematics/solution.rs",
    "shared/robot/cable-robot/src/motion.rs",
    "shared/robot/cable-robot/src/path.rs",
    "shared/robot/cable-robot/src/profile/mod.rs",
    "shared/robot/cable-robot/src/tension/distribution.rs",
    "shared/runtime/config/src/point.rs",
    "shared/runtime/robot-state/src/answers.rs",
    "shared/runtime/robot-state/src/sentences.rs",
];
const SAID: [&str; 7] = [
    "#[error(",
    "write!(f, ",
    "f.write_str(",
    "Err(format!(",
    "(true, format!(",
    "=> (false, ",
    "let segment = format!(",
];

/// The clauses that are parameters of the sentences of the catalogue, and the sentences of a state.
fn clauses() -> BTreeSet<String> {
    let mut clauses = BTreeSet::new();
    for path in WHY {
        let text = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(path)).unwrap();
        let text = text.split("#[cfg(test)]\nmod tests").next().unwrap();
        for begin in SAID {
            clauses.extend(text.split(begin).skip(1).filter_map(|rest| literal(rest.trim_start())));
        }
        // The ends of missions; their faults follow.
        clauses.extend(text.split("Stop { what: ").skip(1).filter_map(|rest| Some(literal(rest)? + ": {faults}")));
    }
    for number in 0..=u8::MAX {
        clauses.insert(sentences::mode_sentence(number).to_owned());
        clauses.insert(sentences::position_sentence(number).to_owned());
        clauses.insert(sentences::verdict_sentence(number).to_owned());
        clauses.extend([0, 1].map(|role| sentences::cause_phrase(role, number).to_owned()));
    }
    // What consists of parameters alone has no words; the page puts faults together with their cables or units.
    let words = |clause: &String| clause.split(['{', '}']).step_by(2).any(|own| own.contains(char::is_alphabetic));
    let faults = |clause: &String| clause == "cable {1}" || clause.starts_with(" on {what}");
    let named = ["; and {left_out} more, which nims status names with their cures", ", and {left_out} more"];
    let all = clauses.iter().map(|clause| template(clause)).chain(named.map(str::to_owned));
    all.filter(|clause| words(clause) && !faults(clause)).collect()
}

/// The faults: each with its effect and its cure.
fn faults() -> BTreeMap<&'static str, [&'static str; 3]> {
    sentences::FAULTS.iter().map(|fault| (fault.clause, [fault.clause, fault.effect, fault.cure])).collect()
}

#[test]
fn the_page_has_the_faults() {
    let path = sources().join("lang/faults.json");
    let rows: Vec<String> = faults().values().map(|texts| format!("  {}", serde_json::json!(texts))).collect();
    let text = format!("[\n{}\n]\n", rows.join(",\n"));
    if std::env::var_os("NIMS_RENEW").is_some() {
        std::fs::write(&path, &text).unwrap();
    }
    let kept = std::fs::read_to_string(&path).unwrap();
    assert!(kept == text, "{} has other faults: run this test with NIMS_RENEW=1", path.display());
}

/// What a person does at a terminal: the page has buttons for it.
const TERMINAL: [&str; 8] = ["Enter", "Eingabetaste", "Intro", "Entrée", "undo", "capture", "quit", "(l or r)"];

#[test]
fn the_page_asks_for_buttons_and_not_for_what_is_typed_at_a_terminal() {
    let read = |language: &str| -> Value {
        let path = sources().join(format!("lang/{language}.json"));
        serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
    };
    let (english, guide) = (read("en"), guide());
    let own = english["guide"].as_object().unwrap();
    let is_word = |text: &str, word: &str| {
        text.match_indices(word).any(|(at, _)| {
            let letter = |one: Option<char>| one.is_some_and(char::is_alphanumeric);
            !letter(text[..at].chars().last()) && !letter(text[at + word.len()..].chars().next())
        })
    };
    let asks = |text: &str| TERMINAL.iter().find(|word| is_word(text, word)).copied();
    for sentence in &guide {
        let told = own.get(sentence).map_or(sentence.as_str(), |told| told.as_str().unwrap());
        assert_eq!(asks(told), None, "en: {told}");
        assert_eq!(parameters(sentence), parameters(told), "en: {sentence}");
    }
    let unused: Vec<_> = own.keys().filter(|sentence| !guide.contains(*sentence)).collect();
    assert!(unused.is_empty(), "en: no sentence of the guided calibration is {unused:#?}");
    for language in LANGUAGES {
        for told in read(language)["guide"].as_object().unwrap().values() {
            assert_eq!(asks(told.as_str().unwrap()), None, "{language}: {told}");
        }
    }
    // A button that a sentence names in quotation marks is there.
    for (language, [before, after]) in
        [("en", ["\"", "\""]), ("de", ["„", "“"]), ("es", ["«", "»"]), ("fr", ["« ", " »"])]
    {
        let (file, labels) = (read(language), labels());
        let shown: BTreeSet<&str> = match file["labels"].as_object() {
            Some(rows) => rows.values().filter_map(Value::as_str).collect(),
            None => labels.iter().map(String::as_str).collect(),
        };
        let mut named = 0;
        for told in file["guide"].as_object().unwrap().values() {
            for part in told
                .as_str()
                .unwrap()
                .replace("pulley = \"swivel\"", "")
                .replace("pulley = \"eye\"", "")
                .split(before)
                .skip(1)
                .step_by(if before == after { 2 } else { 1 })
            {
                let button = part.split(after).next().unwrap();
                assert!(shown.contains(button), "{language}: no button is {button}");
                named += 1;
            }
        }
        assert!(named > 10, "{language} names {named} buttons");
    }
}

/// The text of a literal of Rust at the beginning of a source.
fn literal(source: &str) -> Option<String> {
    let (mut text, mut letters) = (String::new(), source.strip_prefix('"')?.chars().peekable());
    loop {
        match letters.next()? {
            '"' => return Some(text),
            '\\' => match letters.next()? {
                'n' => text.push('\n'),
                // The rest of a sentence stands in the next line.
                '\n' => while letters.next_if(|letter| letter.is_whitespace()).is_some() {},
                other => text.push(other),
            },
            other => text.push(other),
        }
    }
}

/// Checks that a language has each text of a kind and no other, with the same parameters.
fn complete(language: &str, kind: &str, texts: &BTreeSet<String>, own: &BTreeMap<String, String>) {
    let missing: Vec<_> = texts.iter().filter(|text| !own.contains_key(*text)).collect();
    assert!(missing.is_empty(), "{language} lacks the {kind} {missing:#?}");
    let unused: Vec<_> = own.keys().filter(|text| !texts.contains(*text)).collect();
    assert!(unused.is_empty(), "{language}: there is no {kind} {unused:#?}");
    for (text, own) in own {
        assert_eq!(parameters(text), parameters(own), "{language}: {text}");
    }
}

#[test]
fn every_language_has_every_label_and_every_reason() {
    let (templates, labels, guide, clauses) = (templates(), labels(), guide(), clauses());
    let counts = (templates.len(), labels.len(), guide.len(), clauses.len());
    assert!(counts.0 > 200 && counts.1 > 80 && counts.2 > 70 && counts.3 > 90, "{counts:?}");
    for language in LANGUAGES {
        let path = sources().join(format!("lang/{language}.json"));
        let file: Value = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
        let of = |key: &str| -> BTreeMap<String, String> {
            let rows = file[key].as_object().unwrap().iter();
            rows.map(|(key, value)| (key.clone(), value.as_str().unwrap().to_owned())).collect()
        };
        let (own_labels, own_reasons, own_guide) = (of("labels"), of("reasons"), of("guide"));
        complete(language, "sentence of the guided calibration", &guide, &own_guide);
        complete(language, "clause", &clauses, &of("clauses"));
        complete(language, "label of the page", &labels, &own_labels);
        let own_faults = file["faults"].as_object().unwrap();
        assert!(own_faults.keys().eq(faults().keys()), "{language}: the faults are {:#?}", faults().keys());
        for (clause, own) in own_faults {
            // Where there is an effect in English, there is one in the other languages.
            let parts: Vec<bool> =
                own.as_array().unwrap().iter().map(|part| part.as_str().unwrap().is_empty()).collect();
            assert_eq!(parts, faults()[clause.as_str()].map(str::is_empty), "{language}: {clause}");
        }
        for (code, text) in &templates {
            // A sentence that is a parameter alone has no words of its own.
            let words = !matches!(text.strip_prefix('{').and_then(|rest| rest.strip_suffix('}')), Some(one) if !one.contains('{'));
            match own_reasons.get(&code.to_string()) {
                Some(own) => assert_eq!(parameters(text), parameters(own), "{language} {code}: {text}"),
                None => assert!(!words, "{language} has no {code}: {text}"),
            }
        }
        let unknown: Vec<_> =
            own_reasons.keys().filter(|code| !code.parse().is_ok_and(|code| templates.contains_key(&code))).collect();
        assert!(unknown.is_empty(), "{language}: there is no reason {unknown:?}");
    }
}
