//! The page's own translation, run by Node.js: faults, refusals with their clauses and findings are told whole in each
//! language, without an English rest.

#![allow(clippy::unwrap_used, clippy::panic)]

use cable_robot::Vector3;
use cable_robot::motion::{Cause, Refusal};
use cable_robot::motor::DriveLoad;
use cable_robot::obstacle::Contact;
use cable_robot::tension::{TensionError, Violation};
use messages::faults::{Faults, OF_CABLES, OF_UNITS};
use messages::{CONTROLLERS, MotorAuthority, MotorSlots, Slot};
use robot_state::Reason;
use robot_state::answers::detail;
use robot_state::sentences::{FAULTS, StandbyRefusal, faults_of, mode_sentence, position_sentence};
use serde_json::{Value, json};
use std::path::Path;
use std::process::Command;

/// What a browser has and Node.js has not, and a line of JSON for the translations.
const RUN: &str = "globalThis.localStorage = { getItem: () => process.argv[2], setItem() {} };
globalThis.document = { documentElement: {} };
Object.defineProperty(globalThis, 'navigator', { value: { languages: [] }, configurable: true });
const { sentence, translate } = require(process.argv[3]);
const texts = JSON.parse(require('fs').readFileSync(0, 'utf8'));
console.log(JSON.stringify(texts.map(([reason, text]) => reason ? sentence(reason, text) : translate(text))));";

/// Words that no sentence of the other languages has.
const ENGLISH: [&str; 12] = ["the", "is", "and", "of", "with", "would", "it", "unit", "units", "node", "then", "there"];

fn authority(bit: u32) -> MotorAuthority {
    let mut authority = MotorAuthority { faults: bit, ..Default::default() };
    authority.fault_cable[1] = u8::from(bit & OF_CABLES != 0);
    authority.fault_cable[2] = authority.fault_cable[1];
    authority.fault_unit[0] = u8::from(bit & OF_UNITS != 0);
    authority
}

/// Each fault as it stands alone, in refusals and at the end of a mission; two at once; and very many.
fn faults() -> Vec<(u16, String)> {
    let mut texts = Vec::new();
    let all = FAULTS.iter().fold(0, |all, fault| all | fault.bit);
    let pairs = FAULTS.windows(2).map(|two| two[0].bit | two[1].bit);
    for bits in FAULTS.iter().map(|fault| fault.bit).chain(pairs).chain([all]) {
        let authority = authority(bits);
        texts.extend(faults_of(&authority).into_iter().map(|text| (0, text)));
        let faults = Faults::from_authority(&authority);
        for reason in [
            Reason::NotJoggedFaults { faults },
            Reason::NotSoftFaults { faults },
            Reason::EndedByFault { faults },
            Reason::EndedAfterFault { faults },
        ] {
            texts.push((reason.code(), reason.to_string()));
        }
    }
    texts
}

/// Why a motion is refused.
fn causes() -> Vec<Cause> {
    let load = |reel_in_m_s| DriveLoad { tension_n: 31.5, reel_in_m_s, current_a: 4.0, voltage_v: 11.0 };
    let violation = |tension_n| Violation { cable: 1, tension_n, limit_n: 5.0 };
    vec![
        Cause::Tension(violation(2.0)),
        Cause::NoTension(TensionError::Infeasible(violation(80.0))),
        Cause::NoTension(TensionError::Singular),
        Cause::CableSpeed { cable: 0, speed_m_s: 0.5, limit_m_s: 0.4 },
        Cause::Current { cable: 2, load: load(0.0), limit_a: 3.0 },
        Cause::Current { cable: 2, load: load(0.25), limit_a: 3.0 },
        Cause::Voltage { cable: 2, load: load(-0.25), limit_v: 9.0 },
        Cause::NodeSpeed { speed_m_s: 0.5, limit_m_s: 0.4 },
        Cause::NodeAcceleration { acceleration_m_s2: 0.5, limit_m_s2: 0.4 },
        Cause::OutOfPlane { y_m: 0.5 },
        Cause::Ground { below_m: 0.5, ground_m: 0.0 },
        Cause::KeepOut { number: 1 },
        Cause::Obstacle { contact: Contact { obstacle: 0, cable: None }, clearance_m: 0.25 },
        Cause::Obstacle { contact: Contact { obstacle: 0, cable: Some(3) }, clearance_m: 0.25 },
    ]
}

fn refusals() -> Vec<(u16, String)> {
    let mut texts = Vec::new();
    for cause in causes() {
        let refusal = Refusal { position: Vector3::new(1.0, -2.0, 3.0), path_s_m: 0.5, cause };
        texts.push((0, cable_robot::motion::CannotHang(refusal).to_string()));
        let (segment, why) = (detail(" from [1.000, 2.000, 3.000] to [4.000, 5.000, 6.000]"), detail(refusal));
        for feasible_m_s in [None, Some(0.375)] {
            let reason = Reason::PlanLimit { leg: 3, segment, why, feasible_m_s };
            texts.push((reason.code(), reason.to_string()));
        }
        let reason = Reason::CannotHang { position_m: [1.0, 2.0, 3.0], why: detail(refusal) };
        texts.push((reason.code(), reason.to_string()));
    }
    for phase in 0..=MotorSlots::PHASE_QUARANTINED {
        for cause in MotorSlots::CAUSE_NONE..=MotorSlots::CAUSE_PROBATION {
            for verdict in [MotorAuthority::VERDICT_ACCEPTED, MotorAuthority::VERDICT_STALE] {
                let moves_off = Some((0.5, 1.5));
                let why =
                    StandbyRefusal { role: CONTROLLERS, phase, cause, verdict, well_s: 0.0, qualify_s: 2.0, moves_off };
                let reason = Reason::NotSwapped { slot: Slot::B, why };
                texts.push((reason.code(), reason.to_string()));
            }
        }
    }
    texts.extend((0..=8).map(|mode| (0, mode_sentence(mode).to_owned())));
    texts.extend((0..=3).map(|known| (0, position_sentence(known).to_owned())));
    texts
}

/// The texts in a language, as the page tells them.
fn told(bundle: &Path, language: &str, texts: &[(u16, String)]) -> Vec<String> {
    let folder = bundle.parent().unwrap();
    let (run, asked) = (folder.join("run.cjs"), folder.join("asked.json"));
    std::fs::write(&run, RUN).unwrap();
    std::fs::write(&asked, json!(texts).to_string()).unwrap();
    let output = Command::new("node")
        .arg(&run)
        .args([language.as_ref(), bundle.as_os_str()])
        .stdin(std::fs::File::open(&asked).unwrap())
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let told: Value = serde_json::from_slice(&output.stdout).unwrap();
    told.as_array().unwrap().iter().map(|text| text.as_str().unwrap().to_owned()).collect()
}

#[test]
fn faults_and_refusals_are_told_whole_in_each_language() {
    let web = Path::new(env!("CARGO_MANIFEST_DIR")).join("web");
    let esbuild = web.join("node_modules/.bin/esbuild");
    if !esbuild.exists() {
        return notes::left_out("what the page tells in other languages", "the page is not built: scripts/page");
    }
    let folder = tempfile::tempdir().unwrap();
    let bundle = folder.path().join("lang.cjs");
    let built = Command::new(esbuild)
        .arg(web.join("src/lang.ts"))
        .args(["--bundle", "--format=cjs", "--log-level=warning"])
        .arg(format!("--outfile={}", bundle.display()))
        .status()
        .unwrap();
    assert!(built.success());
    let texts: Vec<(u16, String)> = faults().into_iter().chain(refusals()).collect();
    let english = told(&bundle, "en", &texts);
    assert!(texts.len() > 400 && english.iter().eq(texts.iter().map(|(_, text)| text)), "{} texts", texts.len());
    for language in ["de", "es", "fr"] {
        let own = told(&bundle, language, &texts);
        for ((_, english), own) in texts.iter().zip(&own) {
            let mut words = own.split(|letter: char| !letter.is_alphanumeric() && letter != '_' && letter != '-');
            let rest = words.find(|word| ENGLISH.contains(word));
            assert_eq!(rest, None, "{language}: {english}\n{own}");
            let digits = |text: &str| {
                let mut digits: Vec<char> = text.chars().filter(char::is_ascii_digit).collect();
                digits.sort_unstable();
                digits
            };
            assert_eq!(digits(english), digits(own), "{language}: {english}\n{own}");
        }
    }
}
