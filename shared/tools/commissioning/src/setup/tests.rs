use crate::calibrate::{MeasurementsFile, places};
use calibration::{Method, calibrate};
use nims_paper::random::Random;
use proptest::prelude::*;
use site_calibration::setup::captured::CapturedLengths;
use site_calibration::setup::file_text;
use site_calibration::setup::guide::{Guide, NextStep, Reply};
use site_calibration::setup::question::Question;
use std::path::Path;

/// Random pulleys around a centre in the frame of a calibration: the first at the origin, the second on the x axis.
fn site(random: &mut Random, count: usize) -> Vec<[f64; 3]> {
    let turn = if random.uniform() < 0.5 { 1.0 } else { -1.0 };
    let begin = std::f64::consts::TAU * random.uniform();
    let around: Vec<[f64; 3]> = (0..count)
        .map(|i| {
            let share = (i as f64 + 0.4 * random.uniform()) / count as f64;
            let (angle, radius) = (begin + turn * std::f64::consts::TAU * share, 5.0 + 3.0 * random.uniform());
            [radius * angle.cos(), radius * angle.sin(), 2.5 + 1.5 * random.uniform()]
        })
        .collect();
    let (o, p) = (around[0], around[1]);
    let d = (p[0] - o[0]).hypot(p[1] - o[1]);
    let (c, s) = ((p[0] - o[0]) / d, (p[1] - o[1]) / d);
    let turned = |a: &[f64; 3]| {
        let (x, y) = (a[0] - o[0], a[1] - o[1]);
        [c * x + s * y, c * y - s * x, a[2]]
    };
    around.iter().map(turned).collect()
}

/// Simulated team with realistic measurement errors.
struct Team {
    site: Vec<[f64; 3]>,
    random: Random,
    /// Probability of measuring a height directly, and of skipping a distance.
    share: f64,
    /// Whether it types lengths one by one.
    singly: bool,
    /// Place at which it misreads one cable, once.
    wrong_at: Option<usize>,
    /// Lengths at the current point that it has not typed yet.
    reading: Vec<f64>,
    /// Radius of the pulleys, m; 0 for eyes.
    radius_m: f64,
}

impl Team {
    fn new(seed: u64, count: usize) -> Self {
        let mut random = Random::new(seed);
        let site = site(&mut random, count);
        Self { site, random, share: 0.3, singly: false, wrong_at: None, reading: Vec::new(), radius_m: 0.0 }
    }

    fn answer(&mut self, question: &Question) -> String {
        match *question {
            Question::Pulleys => self.site.len().to_string(),
            Question::Distance { needed: false, .. } if self.random.uniform() < self.share => String::new(),
            Question::Distance { from, to, .. } => {
                let (a, b) = (self.site[from - 1], self.site[to - 1]);
                format!("{:.3}", (a[0] - b[0]).hypot(a[1] - b[1]) + 0.005 * self.random.normal())
            }
            Question::Side { pulley, from, to } => {
                let [o, a, b] = [from, to, pulley].map(|k| self.site[k - 1]);
                let cross = (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0]);
                if cross > 0.0 { "l" } else { "Right" }.to_owned()
            }
            Question::Height { pulley } if self.random.uniform() < self.share => {
                format!("{:.1} cm", 100.0 * (self.site[pulley - 1][2] + 0.01 * self.random.normal()))
            }
            Question::Height { .. } | Question::Points | Question::Finish => String::new(),
            Question::ApproximateHeight => "3".to_owned(),
            Question::PulleyRadius if self.radius_m > 0.0 => format!("{:.1} mm", 2000.0 * self.radius_m),
            Question::PulleyTurn => format!("{:.0} mm", 1000.0 * std::f64::consts::TAU * self.radius_m),
            Question::PulleyRadius
            | Question::Confirmation { .. }
            | Question::Tape { .. }
            | Question::TapeDecision { .. } => String::new(),
            Question::Lengths { place } => self.lengths(place),
            Question::PointDecision { .. } => "again".to_owned(),
        }
    }

    fn lengths(&mut self, place: usize) -> String {
        if self.reading.is_empty() {
            let at = places::spots(&self.site, place + 1).pop().unwrap();
            let radii_m = vec![self.radius_m; self.site.len()];
            let at = [0, 1].map(|k| at[k] + 0.2 * self.random.normal());
            self.reading =
                places::lengths(&self.site, &radii_m, &at).iter().map(|m| m + 0.01 * self.random.normal()).collect();
            if self.wrong_at == Some(place) {
                self.reading[1] += 0.5;
                self.wrong_at = None;
            }
        }
        if self.singly {
            return format!("{:.3} m", self.reading.remove(0));
        }
        let all: Vec<String> = self.reading.drain(..).map(|m| format!("{m:.3}").replace('.', ",")).collect();
        all.join(" ")
    }

    /// Answers until the end; returns all typed lines and the final guide.
    fn measure(&mut self) -> (Vec<String>, Guide) {
        let (mut guide, mut typed) = (Guide::default(), Vec::new());
        for _ in 0..200 {
            let line = self.answer(guide.pending());
            typed.push(line.clone());
            let reply = guide.answer(&line);
            if reply.next_step == NextStep::Finish {
                return (typed, guide);
            }
            assert!(reply.changed, "{line:?} to {:?}: {}", guide.pending(), reply.message);
        }
        panic!("the questions do not end: {:?}", guide.pending());
    }
}

fn text(file: &MeasurementsFile) -> String {
    file_text(file, "site.toml").unwrap()
}

/// The guide after restarting the command.
fn again(guide: &Guide) -> Guide {
    Guide::resume(toml::from_str(&text(guide.file())).unwrap()).unwrap()
}

/// A typical session: single readings, one nonsense answer, one misreading, one early end.
fn day(count: usize) -> Vec<String> {
    let mut team = Team { singly: true, wrong_at: Some(5), ..Team::new(7, count) };
    let (mut typed, _) = team.measure();
    typed.insert(4, "a long way".to_owned());
    typed.pop();
    typed.extend(["4", "undo", "2"].map(str::to_owned));
    typed
}

#[test]
fn the_stated_accuracy_is_honest() {
    let (mut sites, mut outside, mut squares, mut count) = (0, 0, 0.0, 0.0);
    for pulleys in [3, 4] {
        for seed in 0..60 {
            let mut team = Team::new(1000 * pulleys as u64 + seed, pulleys);
            let (_, guide) = team.measure();
            let found = calibrate(&guide.file().measurements(Method::Survey).unwrap(), Method::Survey).unwrap();
            let off =
                found.anchors_m.iter().zip(&team.site).zip(found.covariance.std_m()).flat_map(|((is, truth), std)| {
                    (0..3).filter(move |k| std[*k] > 0.0).map(move |k| (is[k] - truth[k]) / std[k])
                });
            let off: Vec<f64> = off.collect();
            assert_eq!(off.len(), 3 * pulleys - 3);
            sites += 1;
            outside += u32::from(off.iter().any(|off| off.abs() > 4.0));
            squares += off.iter().map(|off| off * off).sum::<f64>();
            count += off.len() as f64;
            let worst = found.covariance.worst().2;
            assert!(worst < 0.08, "{worst} m at seed {seed}");
        }
    }
    println!("{outside} of {sites} sites beyond 4 deviations; mean square {:.2}", squares / count);
    assert!(outside <= sites / 20, "{outside} of {sites}");
    assert!((0.7..1.4).contains(&(squares / count)), "{}", squares / count);
}

#[test]
fn a_length_that_is_35_cm_off_is_asked_about() {
    for (cable, by) in [(0, 0.35), (1, -0.35), (2, 0.35)] {
        let mut guide = Guide::default();
        for line in ["3", "9.8", "9.1", "9.4", "l", "", "", "", "3", "4 cm", "126 mm", ""] {
            assert!(guide.answer(line).changed);
        }
        for place in 0..6 {
            let mut shown = site_calibration::setup::question::expected(guide.file(), place).unwrap().lengths_m;
            shown[cable] += by;
            let typed: Vec<String> = shown.iter().map(|m| format!("{m:.3}")).collect();
            if guide.answer(&typed.join(" ")).changed {
                assert_eq!(guide.pending(), &Question::Confirmation { place });
                assert!(guide.question().contains("0.35 m"), "{}", guide.question());
                assert_eq!(guide.file().point.len(), place);
            }
            shown[cable] -= by;
            let typed: Vec<String> = shown.iter().map(|m| format!("{m:.3}")).collect();
            assert!(guide.answer(&typed.join(" ")).changed);
            assert_eq!(guide.file().point.len(), place + 1);
        }
    }
}

#[test]
fn captured_lengths_make_points_whose_zeros_are_found() {
    let mut team = Team { share: 0.0, ..Team::new(31, 4) };
    let (mut guide, zeros) = (Guide::default(), [0.04, -0.03, 0.02, -0.05]);
    let mut captures = 0;
    for _ in 0..100 {
        if let Question::Lengths { place } = *guide.pending() {
            assert!(guide.takes_capture(" Capture ") && !guide.takes_capture("3.1"));
            let line = team.lengths(place).replace(',', ".");
            let lengths_m =
                line.split(' ').zip(zeros).map(|(text, zero)| text.parse::<f64>().unwrap() + zero).collect();
            let captured = CapturedLengths { lengths_m, counts_per_m: vec![10_000.0; 4] };
            assert!(guide.capture(&captured).changed, "{}", guide.question());
            captures += 1;
            assert_eq!(again(&guide), guide);
            // Other lengths have other zeros.
            if guide.pending() == &(Question::Lengths { place: place + 1 }) {
                let before = guide.clone();
                let reply = guide.answer("9.7 3.1 9.0 9.1");
                assert!(!reply.changed && reply.message.contains("capture") && guide == before, "{reply:?}");
                let foreign = CapturedLengths { counts_per_m: vec![9_000.0; 4], ..captured };
                let reply = guide.capture(&foreign);
                assert!(!reply.changed && reply.message.contains("undo") && guide == before, "{reply:?}");
            }
            continue;
        }
        let line = match *guide.pending() {
            Question::Points => "15".to_owned(),
            ref question => team.answer(question),
        };
        if guide.answer(&line).next_step == NextStep::Finish {
            break;
        }
    }
    assert!(captures >= 15, "{captures}");
    let (file, method) = (guide.file(), guide.file().usual_method());
    assert_eq!((method, file.counts_per_m.as_deref()), (Method::Joint, Some(&[10_000.0; 4][..])));
    let found = calibrate(&file.measurements(method).unwrap(), method).unwrap();
    for (i, zero) in zeros.iter().enumerate() {
        assert!((found.offsets_m[i] - zero).abs() < 3.0 * found.offset_std_m[i], "{:?}", found.offsets_m);
        for k in 0..3 {
            let (off, std) = (found.anchors_m[i][k] - team.site[i][k], found.covariance.std_m()[i][k]);
            assert!(off.abs() <= 3.5 * std, "{i} {k}: {off} {std}");
        }
    }
    // Without the captured points, lengths may be typed again.
    while !guide.file().point.is_empty() {
        assert!(guide.answer("undo").changed);
    }
    assert!(guide.answer("9.7").changed || guide.answer("done").message.contains("enough"));
}

#[test]
fn captured_lengths_are_checked_along_a_tape() {
    let mut team = Team { share: 0.0, ..Team::new(33, 4) };
    let scales = [1.012, 0.991, 1.004, 1.0];
    let mut guide = Guide::default();
    while !matches!(guide.pending(), Question::Tape { .. }) {
        if let Question::Lengths { .. } = guide.pending() {
            let line = team.lengths(guide.file().point.len()).replace(',', ".");
            let lengths_m =
                line.split(' ').zip(scales).map(|(text, scale)| text.parse::<f64>().unwrap() * scale).collect();
            assert!(guide.capture(&CapturedLengths { lengths_m, counts_per_m: vec![10_000.0; 4] }).changed);
            continue;
        }
        let line = match *guide.pending() {
            Question::Height { pulley } => format!("{:.3}", team.site[pulley - 1][2]),
            ref question => team.answer(question),
        };
        assert!(guide.answer(&line).changed, "{}", guide.question());
    }
    let before = guide.clone();
    // What no wheel explains is refused, and 35 cm are asked about.
    assert!(guide.answer("3.9").message.contains("cable 1") && guide == before);
    assert!(guide.answer("5.35").changed);
    assert!(guide.question().contains("0.35 m more"), "{}", guide.question());
    assert_eq!(again(&guide), guide);
    assert!(guide.answer("undo").changed && guide == before);
    assert!(guide.answer("5.35").changed && guide.answer("4.941").changed);
    assert_eq!(guide.pending(), &Question::Tape { cable: 2 });
    for line in ["5.000 5.045", "4.980", ""] {
        assert!(guide.answer(line).changed);
        assert_eq!(again(&guide), guide);
    }
    assert_eq!(guide.pending(), &Question::Finish, "{}", guide.question());
    let judged = crate::calibrate::judge(guide.file(), guide.file().usual_method()).unwrap();
    let found: Vec<f64> = serde_json::from_value(judged.value["cable_scale"].clone()).unwrap();
    assert!(found.iter().zip(scales).all(|(found, scale)| (found - scale).abs() < 0.0005), "{found:?}");
    // The zeros, which are right, would imitate the scales.
    let zero_m = |file: &MeasurementsFile| {
        let found = calibrate(&file.measurements(Method::Joint).unwrap(), Method::Joint).unwrap();
        found.offsets_m.iter().fold(0.0, |most: f64, zero| most.max(zero.abs()))
    };
    let (with, without) = (guide.file(), MeasurementsFile { tape: Vec::new(), ..guide.file().clone() });
    assert!(2.0 * zero_m(with) < zero_m(&without), "{} {}", zero_m(with), zero_m(&without));
    for _ in 0..4 {
        assert!(guide.answer("undo").changed);
    }
    assert_eq!(guide, before);
}

/// The team measures over wheels and states their radius to the millimetre.
#[test]
fn the_stated_accuracy_is_honest_over_pulleys() {
    let (mut inside, mut count, mut refused, mut sites) = (0, 0, 0, 0);
    for pulleys in [3, 4] {
        for seed in 0..40 {
            let mut team = Team::new(7000 * pulleys as u64 + seed, pulleys);
            team.radius_m = 0.015 + 0.025 * team.random.uniform();
            let (_, guide) = team.measure();
            sites += 1;
            let method = guide.file().usual_method();
            assert_eq!(method, Method::Joint);
            if crate::calibrate::judge(guide.file(), method).is_err() {
                refused += 1;
                continue;
            }
            let found = calibrate(&guide.file().measurements(method).unwrap(), method).unwrap();
            for ((is, truth), std) in found.anchors_m.iter().zip(&team.site).zip(found.covariance.std_m()) {
                for k in (0..3).filter(|k| std[*k] > 0.0) {
                    inside += u32::from((is[k] - truth[k]).abs() <= 1.96 * std[k]);
                    count += 1;
                }
            }
        }
    }
    let share = f64::from(inside) / f64::from(count);
    println!("{:.1} % of the coordinates within 95 % intervals; {refused} of {sites} sites refused", 100.0 * share);
    assert!((0.90..=0.995).contains(&share), "{share}");
    assert!(refused <= sites / 20, "{refused} of {sites}");
}

#[test]
fn interruption_after_any_answer_changes_nothing() {
    for count in [3, 4, 5] {
        let typed = day(count);
        let mut whole = Guide::default();
        let mut broken = Guide::default();
        for line in &typed {
            let (one, other) = (whole.answer(line), broken.answer(line));
            assert_eq!(one, other);
            assert_eq!(text(whole.file()), text(broken.file()));
            if one.changed {
                broken = again(&broken);
            }
            assert_eq!((broken.pending(), broken.question()), (whole.pending(), whole.question()));
        }
        assert!(whole.file().doubt.len() == 1 && whole.file().point.len() >= 10, "{}", text(whole.file()));
    }
}

#[test]
fn every_answer_can_be_taken_back() {
    for count in [3, 4, 6] {
        let mut guide = Guide::default();
        let mut answers = 0;
        for line in day(count).iter().chain(&["done".to_owned()]).filter(|line| *line != "undo") {
            let before = guide.clone();
            let partly = |guide: &Guide| guide.file().setup.as_ref().unwrap().lengths_so_far_m.len();
            if !guide.answer(line).changed {
                continue;
            }
            answers += 1;
            let mut back = guide.clone();
            assert!(back.answer(" Undo ").changed);
            if partly(&before) > 0 && partly(&guide) == 0 {
                // A point that was typed number by number is taken back as a whole.
                assert_eq!(back.file().point, before.file().point);
                assert_eq!(partly(&back), 0);
            } else {
                assert_eq!(back, before, "after {line:?}");
            }
        }
        assert!(answers > 30, "{answers}");
        let mut steps = 0;
        while guide.answer("undo").changed {
            steps += 1;
            assert_eq!(again(&guide), guide);
            assert!(steps < 300);
        }
        assert_eq!(guide, Guide::default());
        let reply = guide.answer("undo");
        assert!(!reply.changed && !reply.message.is_empty() && guide == Guide::default(), "{reply:?}");
    }
}

#[test]
fn nonsense_is_rejected_at_every_question() {
    let mut guide = Guide::default();
    let mut lines = day(4);
    lines.push("done".to_owned());
    for line in &lines {
        for nonsense in
            ["-", "blah", "1e9", "nan", "-3", "0", "9999", "3 4 5 6 7 8 9 10 11", "\u{0}\u{7}", "ſ", "12 ft", "keep it"]
        {
            let mut tried = guide.clone();
            let Reply { message, changed, next_step } = tried.answer(nonsense);
            assert!(
                !changed && next_step == NextStep::Ask && !message.is_empty(),
                "{nonsense:?} to {:?}: {message}",
                guide.pending()
            );
            assert!(message.ends_with('.') && message.lines().count() == 1, "{message}");
            assert_eq!(tried, guide);
        }
        guide.answer(line);
    }
    assert_eq!(guide.pending(), &Question::Finish);
}

#[test]
fn distances_without_a_triangle_are_rejected_by_name() {
    let mut guide = Guide::default();
    for line in ["3", "9.8", "9.1"] {
        assert!(guide.answer(line).changed);
    }
    let message = guide.answer("25").message;
    for name in ["1-2 (9.80 m)", "1-3 (9.10 m)", "2-3 (25.00 m)", "undo"] {
        assert!(message.contains(name), "{message}");
    }
    assert!(guide.answer("").message.contains("2-3"), "the distance is needed");
    assert!(guide.answer("9,4").changed);
    assert_eq!(guide.pending(), &Question::Side { pulley: 3, from: 1, to: 2 });
    // Collinear pulleys determine no shape.
    let mut flat = Guide::default();
    for line in ["3", "5", "10"] {
        flat.answer(line);
    }
    let (before, reply) = (flat.clone(), flat.answer("5"));
    assert!(!reply.changed && !reply.message.is_empty() && flat == before, "{reply:?}");
    // With four pulleys one distance may be skipped, but no second one; six contradicting distances give a hint.
    let square = ["4", "10", "10", "14.142", "l", "14.142", "", "10"];
    let mut guide = Guide::default();
    for line in square {
        assert!(guide.answer(line).changed, "{line} {}", guide.question());
    }
    assert_eq!(guide.pending(), &Question::Side { pulley: 4, from: 1, to: 3 });
    let mut guide = Guide::default();
    for line in &square[..6] {
        guide.answer(line);
    }
    assert!(guide.answer("10.4").changed);
    let message = guide.answer("10").message;
    // The distance that is off by most.
    assert!(message.contains('-') && message.contains(" m"), "{message}");
}

#[test]
fn a_point_that_does_not_fit_is_named_and_can_be_kept() {
    for count in [3, 4] {
        let mut team = Team { wrong_at: Some(6), share: 0.0, ..Team::new(3, count) };
        let mut guide = Guide::default();
        while !matches!(guide.pending(), Question::PointDecision { .. }) {
            assert_ne!(guide.pending(), &Question::Finish, "a wrong reading of half a metre was not detected");
            let line = team.answer(guide.pending());
            guide.answer(&line);
        }
        let Question::PointDecision { place, doubtful } = guide.pending().clone() else { panic!() };
        assert_eq!((place, doubtful.point), (6, 7), "{}", guide.question());
        let mut kept = guide.clone();
        let message = kept.answer("keep").message;
        assert!(message.contains('±'), "{message} {}", kept.question());
        assert_eq!(kept.pending(), &Question::Lengths { place: 7 });
        guide.answer("again");
        assert_eq!(guide.pending(), &Question::Lengths { place: 6 });
        let line = team.answer(guide.pending());
        assert!(guide.answer(&line).message.contains('±'));
        assert_eq!(guide.pending(), &Question::Lengths { place: 7 });
        assert_eq!(guide.file().used(Method::Survey), [0, 1, 2, 3, 4, 5, 7]);
    }
}

#[test]
fn a_wrong_height_is_suggested_when_a_point_does_not_fit() {
    let mut team = Team { share: 0.0, ..Team::new(5, 3) };
    let mut guide = Guide::default();
    while !matches!(guide.pending(), Question::PointDecision { .. }) {
        let line = match guide.pending() {
            Question::Finish => panic!("a height that is wrong by 30 cm was not detected"),
            Question::Height { pulley: 2 } => format!("{:.2}", team.site[1][2] + 0.3),
            question => team.answer(question),
        };
        guide.answer(&line);
    }
    assert!(guide.question().contains("pulley 2"), "{}", guide.question());
}

#[test]
fn impossible_or_unexpected_lengths_give_a_message() {
    let mut guide = Guide::default();
    for line in ["3", "9.8", "9.1", "9.4", "l", "", "", "", "3", "", ""] {
        assert!(guide.answer(line).changed);
    }
    assert!(guide.question().contains("pulley 1"), "{}", guide.question());
    let apart = guide.answer("3.0 3.0 9.2");
    assert!(!apart.changed && ["1", "2"].iter().all(|cable| apart.message.contains(cable)), "{apart:?}");
    assert!(guide.answer("3.0 9.6").message.contains("type 3"));
    let early = guide.answer("done");
    assert!(!early.changed && early.next_step == NextStep::Ask && !early.message.is_empty(), "{early:?}");
    // Far from what the question showed: asked about, and used only after an answer.
    let shown = guide.question();
    assert!(guide.answer("9.7 3.1 9.0").changed);
    assert!(guide.question().contains("Cable 2"), "{}", guide.question());
    assert!(guide.file().point.is_empty());
    assert_eq!(again(&guide), guide);
    assert!(guide.answer("done").message.contains("first"));
    assert!(guide.answer("3.1").message.contains("3"));
    assert!(guide.answer("3.10 9.75 9.10").changed && guide.file().point.len() == 1, "{shown} {}", guide.question());
}

/// Messages and questions of dialogues without random numbers, word for word.
#[test]
fn the_sentences_are_those_of_the_file() {
    let first = ["3", "9.8", "9.1", "9.4", "l", "", "", "", "3", "", ""];
    let then = ["3.0 3.0 9.2", "3.0 9.6", "done", "9.7 3.1 9.0", "done", "3.1", "3.10 9.75 9.10"];
    let dialogues = [
        &["undo", "3", "9.8", "9.1", "25", "", "9,4"][..],
        &["3", "5", "10", "5"],
        &["4", "10", "10", "14.142", "l", "14.142", "10.4", "10"],
        &[&first[..], &then].concat(),
    ];
    let mut given = Vec::new();
    for (number, lines) in (1..).zip(dialogues) {
        let mut guide = Guide::default();
        for line in lines {
            let message = guide.answer(line).message;
            given.push((format!("dialogue {number}, {line:?}"), format!("{message} | {}", guide.question())));
        }
    }
    sentences::compare_with(&Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/setup.txt"), given);
}

#[test]
fn foreign_files_are_not_continued() {
    let cases = [
        ("[[range]]\nfrom = 1\nto = 2\nm = 9.0\n", "[setup]"),
        ("[setup]\npulleys = 9\n", "3 to 8"),
        ("[setup]\npulleys = 3\n[[range]]\nfrom = 1\nto = 4\nm = 9.0\n", "pulley 4"),
        ("[setup]\npulleys = 3\n[[point]]\nlengths_m = [1.0]\n", "one length for each"),
        ("[setup]\npulleys = 3\n[[point]]\nlengths_m = [1.0, 2.0, 3.0]\n", "asked before"),
        ("[setup]\npulleys = 3\n[[doubt]]\npoint = 1\nuse = true\nafter = 1\n", "[[doubt]]"),
    ];
    for (text, word) in cases {
        let why = Guide::resume(toml::from_str(text).unwrap()).unwrap_err();
        assert!(why.contains(word), "{why}");
    }
}

/// Found by the dialogues below: wheels of 72 mm take up more than a cable of 0.1 m.
#[test]
fn a_length_that_the_wheel_uses_up_leaves_a_file_that_can_be_continued() {
    let mut guide = Guide::default();
    for line in [
        "3", "9.8", "9.1", "9.4", "l", "30", "1", "30", "14,4cm", "45 cm", "3", "10cm", "10", "10", "", "10 10 10", "",
        "9 9 9", "",
    ] {
        guide.answer(line);
        assert_eq!(again(&guide), guide);
    }
    assert!(guide.file().point.len() == 3 && guide.question().contains("72 mm"), "{}", guide.question());
}

/// `NIMS_DIALOGUES` sets how many dialogues are drawn.
fn dialogues() -> ProptestConfig {
    let cases = std::env::var("NIMS_DIALOGUES").map_or(48, |count| count.parse().unwrap());
    ProptestConfig { cases, failure_persistence: None, ..ProptestConfig::default() }
}

proptest! {
    #![proptest_config(dialogues())]

    #[test]
    fn any_input_leaves_a_file_that_can_be_continued(
        lines in prop::collection::vec(
            prop_oneof![
                3 => "\\PC{0,12}",
                6 => "[0-9]{1,2}([.,][0-9]{1,3})?( ?c?m)?",
                3 => "([0-9]{1,2}\\.[0-9] ){3}",
                2 => Just(String::new()),
                2 => prop::sample::select(vec!["undo", "done", "keep", "again", "l", "r", "3", "4", "?"]).prop_map(str::to_owned),
            ],
            0..60,
        ),
    ) {
        let mut guide = Guide::default();
        for line in ["3", "9.8", "9.1", "9.4", "l"].map(str::to_owned).iter().chain(&lines) {
            let before = guide.clone();
            let reply = guide.answer(line);
            prop_assert!(!guide.question().is_empty());
            if reply.changed {
                prop_assert_eq!(&again(&guide), &guide);
            } else {
                prop_assert_eq!(&before, &guide);
            }
        }
    }
}
