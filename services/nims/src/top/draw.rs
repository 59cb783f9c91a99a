//! Draws a snapshot; a pure function.

use super::snapshot::{Recording, Snapshot};
use crate::status::{mission_words, mode_name, position_words};
use client::state_name;
use config::ControlLaw;
use controller::Law;
use messages::{
    CONTROLLERS, ESTIMATORS, Heartbeat, MotorAuthority, MotorState, ProcessState, SLOT_NAMES, SLOTS, text_of,
};
use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Modifier, Style};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, Paragraph, Wrap};
use robot_state::{Periods, sentences};

/// Age from which a sample is stale, s: the slowest channels publish once a second.
const OLD_S: f64 = 2.5;
/// Terminal width from which the channels are drawn beside the processes, characters.
const WIDE: u16 = 120;
/// Terminal height from which long text lines are wrapped, characters.
const TALL: u16 = 30;
/// Width of a bar, characters: three of them with their figures fit into 80.
const BAR: usize = 10;

/// Draws the robot, or the reason why there is none.
pub fn draw(frame: &mut Frame<'_>, snapshot: &Snapshot) {
    let area = frame.area();
    let Some(domain) = &snapshot.domain else {
        let text =
            vec![Line::from(snapshot.waiting.clone()), Line::from(""), Line::from("Waiting for a robot; q quits.")];
        let block = Block::bordered().title(" nims ");
        frame.render_widget(Paragraph::new(text).wrap(Wrap { trim: true }).block(block), area);
        return;
    };
    let width = usize::from(area.width).max(1);
    let mut robot = robot(snapshot);
    if area.height < TALL {
        // Every panel has its place in 80 x 24. What warns is wrapped; the last part of another long text line is left
        // out.
        robot = robot.into_iter().map(|line| if warns(&line) { line } else { cut(line, width) }).collect();
    }
    let (cables, control, processes) = (cables(snapshot), control(snapshot), processes(snapshot));
    let rows = |lines: &[Line<'_>]| {
        let wrapped: usize = lines.iter().map(|line| line.width().max(1).div_ceil(width)).sum();
        Constraint::Length(u16::try_from(wrapped + 1).unwrap_or(u16::MAX))
    };
    let [top, middle, slots, rest, keys] =
        Layout::vertical([rows(&robot), rows(&cables), rows(&control), Constraint::Min(0), Constraint::Length(1)])
            .areas(area);
    let [left, right] = if area.width >= WIDE {
        Layout::horizontal([Constraint::Fill(3), Constraint::Fill(2)]).spacing(2).areas(rest)
    } else {
        Layout::vertical([rows(&processes), Constraint::Min(0)]).areas(rest)
    };
    panel(frame, top, format!("NIMS {domain}"), robot);
    panel(frame, middle, cables_head(), cables);
    panel(frame, slots, format!("{:<11}{:<11} {:<14} {}", "CONTROL", "slot", "law", "verdict"), control);
    panel(frame, left, process_head(), fitting(processes, left.height));
    if right.height > 1 {
        panel(frame, right, channel_head(right.width), channels(snapshot, right.height - 1, right.width));
    }
    frame.render_widget(Paragraph::new(key_line(snapshot)), keys);
}

/// A text line with the title and the heads of the columns, and the rows below it.
fn panel(frame: &mut Frame<'_>, area: Rect, head: String, mut lines: Vec<Line<'_>>) {
    let width = usize::from(area.width);
    lines.insert(0, Line::styled(format!("{head:<width$}"), Style::new().add_modifier(Modifier::REVERSED)));
    frame.render_widget(Paragraph::new(lines).wrap(Wrap { trim: false }), area);
}

/// The rows that fit below the head, the last of them with the number of the others.
fn fitting(mut lines: Vec<Line<'static>>, height: u16) -> Vec<Line<'static>> {
    let room = usize::from(height.saturating_sub(1));
    if lines.len() > room && room > 0 {
        let hidden = lines.len() - room + 1;
        lines.truncate(room - 1);
        lines.push(Line::from(format!("and {hidden} more; `nims status` shows all")));
    }
    lines
}

/// The keys, or the answer to the last one.
fn key_line(snapshot: &Snapshot) -> Line<'static> {
    if snapshot.answer.is_empty() {
        Line::styled(
            "q quit   p pause, keeps the mission   s stop, drops it; the cables stay taut",
            Style::new().fg(Color::DarkGray),
        )
    } else {
        Line::from(styled(snapshot.answer.clone(), Color::Yellow))
    }
}

fn warns(line: &Line<'_>) -> bool {
    line.spans.iter().any(|span| matches!(span.style.fg, Some(Color::Red | Color::Yellow)))
}

/// Leaves out the last parts of a text line, between `; `, that do not fit into the width.
fn cut(mut line: Line<'static>, width: usize) -> Line<'static> {
    while line.width() > width
        && let Some(last) = line.spans.pop()
    {
        if let Some((first, _)) = last.content.rsplit_once("; ") {
            line.spans.push(Span::styled(first.to_owned(), last.style));
        } else if let Some(before) = line.spans.last_mut() {
            before.content = before.content.trim_end_matches("; ").to_owned().into();
        }
    }
    line
}

fn styled(text: impl Into<String>, color: Color) -> Span<'static> {
    Span::styled(text.into(), Style::new().fg(color).add_modifier(Modifier::BOLD))
}

fn labelled(label: &str, mut spans: Vec<Span<'static>>) -> Line<'static> {
    spans.insert(0, Span::styled(format!("{label:<10} "), Style::new().fg(Color::DarkGray)));
    Line::from(spans)
}

/// Mode, faults, position, mission, cycle and recording.
fn robot(snapshot: &Snapshot) -> Vec<Line<'static>> {
    let mut lines = Vec::new();
    match &snapshot.authority {
        None => {
            lines.push(labelled("mode", vec![styled("motor-io is not running; the robot cannot move", Color::Red)]))
        }
        Some(authority) => {
            let age_s = snapshot.age_s(authority.header.stamp_ns);
            if age_s > OLD_S {
                lines.push(labelled(
                    "mode",
                    vec![styled(
                        format!(
                            "no message from motor-io for {age_s:.0} s; the watchdog of the drives has stopped the motors; last mode: {}",
                            mode_name(authority.mode)
                        ),
                        Color::Red,
                    )],
                ));
            } else {
                lines.push(labelled(
                    "mode",
                    vec![
                        styled(mode_name(authority.mode).to_uppercase(), color_of(authority.mode)),
                        Span::raw(format!("  {}", sentences::mode_sentence(authority.mode))),
                    ],
                ));
            }
            for fault in sentences::faults_of(authority) {
                lines.push(labelled("fault", vec![styled(fault, Color::Red)]));
            }
            lines.push(labelled("position", place(snapshot, authority)));
        }
    }
    if let Some(plan) = &snapshot.plan {
        let mut words = mission_words(plan, snapshot.authority.as_ref());
        if let Some(rate) = snapshot.authority.map(|authority| authority.plan_rate).filter(|rate| *rate > 0.0) {
            words += &format!("; clock {:.0} %", 100.0 * rate);
        }
        lines.push(labelled("mission", vec![Span::raw(words)]));
    }
    if let Some(authority) = &snapshot.authority {
        lines.extend(cycle(authority));
    }
    lines.push(recording(snapshot));
    lines
}

fn color_of(mode: u8) -> Color {
    match mode {
        MotorAuthority::MODE_FAULTED | MotorAuthority::MODE_EMERGENCY_STOP => Color::Red,
        MotorAuthority::MODE_FOLLOWING | MotorAuthority::MODE_JOGGING | MotorAuthority::MODE_SOFT => Color::Green,
        MotorAuthority::MODE_STOPPING => Color::Yellow,
        MotorAuthority::MODE_HOLDING => Color::Cyan,
        _ => Color::Gray,
    }
}

fn place(snapshot: &Snapshot, authority: &MotorAuthority) -> Vec<Span<'static>> {
    let motor_io = snapshot.processes.iter().map(|(row, _)| row).find(|row| text_of(&row.name) == "motor-io");
    let known = position_words(authority.position_known, motor_io, snapshot.now_ns);
    let active = usize::from(authority.active_estimator).min(1);
    let estimate = snapshot.estimate[active]
        .filter(|estimate| snapshot.age_s(estimate.header.stamp_ns) < OLD_S && estimate.valid == 1);
    let is_known = authority.position_known == MotorState::POSITION_KNOWN;
    let known = if is_known { Span::raw(known) } else { styled(known, Color::Yellow) };
    let Some(estimate) = estimate else {
        return vec![known];
    };
    let [x, y, z] = estimate.position_m;
    let error = snapshot.control[usize::from(authority.active_controller).min(1)]
        .filter(|control| control.valid == 1 && control.segment != 0)
        .map(|control| format!("; {:.1} mm from the setpoint", 1000.0 * control.error_norm_m));
    vec![Span::raw(format!("node at {x:.3}, {y:.3}, {z:.3} m{}; ", error.unwrap_or_default())), known]
}

fn cycle(authority: &MotorAuthority) -> [Line<'static>; 2] {
    let milliseconds = |ns: u64| ns as f64 * 1e-6;
    let periods = Periods::from_authority(authority);
    let count = Span::raw(format!("{} at {:.0} Hz; ", authority.header.cycle, 1.0 / authority.period_s));
    let steered = match periods.unsteered() {
        0 => Span::raw(periods.summary()),
        _ => styled(periods.summary(), Color::Yellow),
    };
    let timing = format!(
        "bus {:.1} ms, woke {:.1} ms late, command {:.1} ms old",
        milliseconds(authority.bus_ns),
        milliseconds(authority.wake_ns),
        milliseconds(authority.command_age_ns)
    );
    [labelled("cycle", vec![count, steered]), labelled("timing", vec![Span::raw(timing)])]
}

fn recording(snapshot: &Snapshot) -> Line<'static> {
    let Some(recording) = &snapshot.recording else {
        return labelled("recording", vec![styled("no message from the recorder", Color::Yellow)]);
    };
    let Recording { why, bytes, lost, free_bytes, stamp_ns } = recording;
    let age_s = snapshot.age_s(*stamp_ns);
    let state = why.as_ref().map_or_else(String::new, |why| format!("NOT RECORDING: {why}, "));
    let run = snapshot.run.rsplit('/').next().unwrap_or_default();
    let (megabytes, free) = (*bytes as f64 * 1e-6, *free_bytes as f64 * 1e-9);
    let words = format!("{state}{megabytes:.1} MB, {lost} lost, {free:.1} GB left; {run}");
    if age_s > OLD_S {
        labelled("recording", vec![styled(format!("no message from the recorder for {age_s:.0} s"), Color::Red)])
    } else if why.is_none() {
        labelled("recording", vec![Span::raw(words)])
    } else {
        labelled("recording", vec![styled(words, Color::Red)])
    }
}

fn cables_head() -> String {
    let (length, speed) = ("length", "speed");
    format!("{:<13}{length:>8}   {speed:>7}      {:<BAR$}{:>7}    {:<BAR$}{:>7}", "CABLE", "", "tension", "", "current")
}

/// Length, tension and current of each cable.
fn cables(snapshot: &Snapshot) -> Vec<Line<'static>> {
    let Some(state) = snapshot.state else { return vec![Line::from("no reading from the drives yet")] };
    let active = snapshot.authority.map_or(0, |authority| usize::from(authority.active_estimator).min(1));
    let estimate = snapshot.estimate[active]
        .filter(|estimate| estimate.valid == 1 && snapshot.age_s(estimate.header.stamp_ns) < OLD_S);
    let scale = &snapshot.scale;
    let count = usize::from(state.cable_count).min(state.length_m.len());
    (0..count)
        .map(|cable| {
            let (length, current) = (state.length_m[cable], state.current_a[cable]);
            let mut spans = vec![Span::raw(format!("{} ", cable + 1))];
            spans.push(bar(length / scale.length_m, Color::Blue));
            spans.push(Span::raw(format!(" {length:8.3} m {:+7.3} m/s  ", state.velocity_m_s[cable])));
            match estimate.map(|estimate| (estimate.tension_n[cable], estimate.slack[cable])) {
                Some((tension, slack)) => {
                    let [least, greatest] = scale.tension_n;
                    let sound = slack == 0 && (least..=greatest).contains(&tension);
                    spans.push(bar(tension / greatest, if sound { Color::Green } else { Color::Red }));
                    let mark = if slack == 1 { " SLACK" } else { "" };
                    spans.push(Span::raw(format!(" {tension:6.1} N{mark}  ")));
                }
                None => spans.push(Span::raw(format!("{:BAR$}      ? N  ", ""))),
            }
            let color = if current.abs() > 0.9 * scale.current_a { Color::Red } else { Color::Magenta };
            spans.push(bar(current.abs() / scale.current_a, color));
            spans.push(Span::raw(format!(" {current:6.2} A")));
            if state.fresh[cable] == 0 {
                spans.push(styled("  no reading", Color::Yellow));
            }
            Line::from(spans)
        })
        .collect()
}

/// A bar for a fraction of the full scale; empty if the fraction is not finite.
fn bar(share: f64, color: Color) -> Span<'static> {
    let filled = if share.is_finite() { (share.clamp(0.0, 1.0) * BAR as f64).round() as usize } else { 0 };
    Span::styled("█".repeat(filled) + &"░".repeat(BAR - filled), Style::new().fg(color))
}

/// Controller and estimator in each slot, with the progress of their qualification and motor-io's verdict.
fn control(snapshot: &Snapshot) -> Vec<Line<'static>> {
    let Some(authority) = snapshot.authority else { return vec![Line::from("motor-io is not running")] };
    let mut lines = Vec::new();
    for (slot, name) in SLOT_NAMES.iter().enumerate() {
        let status = snapshot.control[slot].filter(|status| snapshot.age_s(status.header.stamp_ns) < OLD_S);
        let in_charge = usize::from(authority.in_charge[CONTROLLERS]) == slot;
        if status.is_none() && !in_charge && failure_cause(snapshot, CONTROLLERS, slot).is_empty() {
            continue;
        }
        let law = status.map_or("empty", |status| Law::numbered(status.law).map_or("custom law", ControlLaw::name));
        let words = format!("{law:<14} {}", sentences::verdict_sentence(authority.verdict[slot]));
        lines.push(slot_line(snapshot, CONTROLLERS, slot, name, in_charge, words));
    }
    for (slot, name) in SLOT_NAMES.iter().enumerate() {
        let estimate = snapshot.estimate[slot].filter(|estimate| snapshot.age_s(estimate.header.stamp_ns) < OLD_S);
        let in_charge = usize::from(authority.in_charge[ESTIMATORS]) == slot;
        let words = match estimate {
            None if !in_charge && failure_cause(snapshot, ESTIMATORS, slot).is_empty() => continue,
            None => "empty".to_owned(),
            Some(estimate) if estimate.valid == 1 => {
                format!("lengths agree within {:.1} mm", 1000.0 * estimate.residual_m)
            }
            Some(_) => "no valid estimate".to_owned(),
        };
        lines.push(slot_line(snapshot, ESTIMATORS, slot, name, in_charge, words));
    }
    lines
}

fn slot_line(
    snapshot: &Snapshot,
    role: usize,
    slot: usize,
    name: &str,
    in_charge: bool,
    words: String,
) -> Line<'static> {
    let role_name = sentences::ROLE_NAMES[role];
    let mark = if in_charge { styled("IN CHARGE", Color::Green) } else { Span::raw("         ") };
    let mut spans = vec![Span::raw(format!("{role_name:<10} {name} ")), mark, Span::raw(format!(" {words}"))];
    if let Some(slots) = &snapshot.slots {
        spans.push(Span::raw(format!("  {}", crate::swap::progress(role, SLOTS * role + slot, slots))));
    }
    let cause = failure_cause(snapshot, role, slot);
    if !cause.is_empty() {
        spans.push(styled(format!(" (it {cause})"), Color::Yellow));
    }
    Line::from(spans)
}

/// Why a slot was last disqualified; empty if it was not.
fn failure_cause(snapshot: &Snapshot, role: usize, slot: usize) -> &'static str {
    snapshot.slots.map_or("", |slots| sentences::cause_phrase(role, slots.cause[SLOTS * role + slot]))
}

fn processes(snapshot: &Snapshot) -> Vec<Line<'static>> {
    if snapshot.processes.is_empty() {
        return vec![Line::from(styled("no supervisor: the processes are not monitored", Color::Red))];
    }
    let newest = snapshot.processes.iter().map(|(row, _)| row.header.stamp_ns).max().unwrap_or(0);
    let mut lines = Vec::new();
    let age_s = snapshot.age_s(newest);
    if age_s > OLD_S {
        lines.push(Line::from(styled(
            format!("no message from the supervisor for {age_s:.0} s; the states below are old"),
            Color::Red,
        )));
    }
    lines.extend(snapshot.processes.iter().map(|(row, beat)| process(row, beat.as_ref())));
    lines
}

fn process_head() -> String {
    format!("{:<20} {:<13} {:>7} {:>8} {:>9}", "PROCESS", "state", "pid", "busy µs", "99 % µs")
}

fn process(row: &ProcessState, beat: Option<&Heartbeat>) -> Line<'static> {
    let color = match row.state {
        ProcessState::STATE_READY | ProcessState::STATE_RUNNING => Color::Green,
        ProcessState::STATE_STOPPED => Color::Gray,
        ProcessState::STATE_STARTING | ProcessState::STATE_STOPPING => Color::Yellow,
        _ => Color::Red,
    };
    let law = text_of(&row.law);
    let name = if law.is_empty() { text_of(&row.name) } else { format!("{} ({law})", text_of(&row.name)) };
    let mut spans = vec![Span::raw(format!("{name:<20} ")), styled(format!("{:<13} ", state_name(row.state)), color)];
    let pid = if row.pid == 0 { String::new() } else { row.pid.to_string() };
    spans.push(Span::raw(format!("{pid:>7} ")));
    if let Some(beat) = beat.filter(|_| row.exit_code == -1 && row.signal == 0) {
        let microseconds = |ns: u64| ns as f64 * 1e-3;
        spans.push(Span::raw(format!(
            "{:>8.0} {:>9.0}",
            microseconds(beat.busy_p50_ns),
            microseconds(beat.busy_p99_ns)
        )));
        if beat.lost > 0 {
            spans.push(styled(format!(", {} lost", beat.lost), Color::Yellow));
        }
    }
    if row.restarts > 0 {
        spans.push(styled(format!(" restarted {}x", row.restarts), Color::Yellow));
    }
    let reason = text_of(&row.reason);
    if !reason.is_empty() {
        spans.push(Span::raw(format!(" {reason}")));
    }
    Line::from(spans)
}

/// Width of the names of channels.
fn name_width(width: u16) -> usize {
    usize::from(width.saturating_sub(21)).clamp(12, 40)
}

fn channel_head(width: u16) -> String {
    let name_width = name_width(width);
    format!("{:<name_width$} {:>7}     lost", "CHANNEL", "rate")
}

/// As many channels as fit: channels with losses first, then the fastest.
fn channels(snapshot: &Snapshot, height: u16, width: u16) -> Vec<Line<'static>> {
    let mut rows: Vec<_> = snapshot.channels.iter().collect();
    if rows.is_empty() {
        return vec![Line::from("no counts from the recorder yet")];
    }
    rows.sort_by(|a, b| b.lost.cmp(&a.lost).then(b.hz.total_cmp(&a.hz)).then(a.name.cmp(&b.name)));
    let name_width = name_width(width);
    let height = usize::from(height);
    let shown = if rows.len() > height { height.saturating_sub(1) } else { rows.len() };
    let mut lines: Vec<Line<'static>> = rows
        .iter()
        .take(shown)
        .map(|row| {
            let lost =
                if row.lost == 0 { Span::raw("0 lost") } else { styled(format!("{} lost", row.lost), Color::Yellow) };
            Line::from(vec![Span::raw(format!("{:<name_width$} {:7.1} Hz  ", row.name, row.hz)), lost])
        })
        .collect();
    if shown < rows.len() {
        lines.push(Line::from(format!("and {} more; `nims channel hz` shows all", rows.len() - shown)));
    }
    lines
}

#[cfg(test)]
mod tests;
