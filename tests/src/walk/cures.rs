//! Cures named by sentences: each refusal and each reason for the end of a mission must name an action.

/// What an operator can do about a refusal.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cure {
    /// `nims arm`.
    Arm,
    /// `nims reset`.
    Reset,
    /// `nims stop`.
    Stop,
    /// `nims resume`.
    Resume,
    /// `nims confirm-position`.
    Confirm,
    /// `nims zero`, at the true position of the node.
    Zero,
    /// `nims swap --admit`.
    Admit,
    /// Wait for a second.
    Wait,
    /// Start the processes that `nims status` does not show, and read its faults.
    Status,
    /// Start everything that is missing.
    Up,
    /// Request another motion, or phrase the request differently: this one is impossible.
    AskOtherwise,
    /// Restart the estimator in charge.
    Restart,
    /// Let another controller take over, `nims swap controller`.
    OtherController,
    /// Jog the named cable taut.
    JogTaut,
}

/// Words of sentences, and the cure that each means.
const WORDS: [(&str, Cure); 48] = [
    ("reset, see", Cure::Reset),
    ("restart the one that is off", Cure::Restart),
    ("swap to another controller", Cure::OtherController),
    ("look at its log", Cure::Status),
    ("look at its configuration", Cure::Status),
    ("run it without --continue", Cure::AskOtherwise),
    ("nims arm", Cure::Arm),
    ("arm first", Cure::Arm),
    ("arm and start", Cure::Arm),
    ("nims reset", Cure::Reset),
    ("reset it", Cure::Reset),
    ("then reset", Cure::Reset),
    ("reset, then", Cure::Reset),
    ("nims stop", Cure::Stop),
    ("stop first", Cure::Stop),
    ("stop to give it up", Cure::Stop),
    ("stop, then start", Cure::Stop),
    ("nims resume", Cure::Resume),
    ("then resume", Cure::Resume),
    ("again, resume", Cure::Resume),
    ("resume goes on", Cure::Resume),
    ("nims confirm-position", Cure::Confirm),
    ("confirm it", Cure::Confirm),
    ("confirm the position", Cure::Confirm),
    ("nims zero", Cure::Zero),
    ("or zero", Cure::Zero),
    ("zero the robot", Cure::Zero),
    ("zero before", Cure::Zero),
    ("--admit", Cure::Admit),
    ("try again in a second", Cure::Wait),
    ("ask again", Cure::Wait),
    ("wait until", Cure::Wait),
    ("wait for its end", Cure::Wait),
    ("when it holds", Cure::Wait),
    ("ask it again", Cure::Wait),
    ("request it again", Cure::Wait),
    ("then try again", Cure::Wait),
    ("nims status", Cure::Status),
    ("start one first", Cure::Up),
    ("nims up", Cure::Up),
    ("accepted:", Cure::AskOtherwise),
    ("; give", Cure::AskOtherwise),
    ("; ask for", Cure::AskOtherwise),
    ("new motion", Cure::AskOtherwise),
    ("start a new one", Cure::AskOtherwise),
    ("start new one", Cure::AskOtherwise),
    ("jog the cable taut", Cure::JogTaut),
    ("move back inside", Cure::AskOtherwise),
];

/// The cures that this sentence names, without duplicates.
pub fn cures(sentence: &str) -> Vec<Cure> {
    let mut found = Vec::new();
    for (words, cure) in WORDS {
        if sentence.contains(words) && !found.contains(&cure) {
            found.push(cure);
        }
    }
    found
}

/// Sentences without a cure: the request is already fulfilled, or cannot be expressed differently.
pub fn is_settled(sentence: &str) -> bool {
    ["already there", "There is no paused motion", "there is no paused motion"]
        .iter()
        .any(|words| sentence.contains(words))
}
