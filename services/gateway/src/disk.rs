//! What touches the disk, on a thread of its own: a disk can block for seconds, and a stop must not wait for it.

use crate::events::{Done, Ticket, TokenChange};
use crate::plugin::{self, Verb};
use crate::robot_file::{self, RobotTexts};
use crate::{make, runs};
use gateway_protocol::{FileRow, Reply, RunFiles};
use robot_state::Reason;
use robot_state::answers::detail;
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, Sender, SyncSender, TrySendError, channel, sync_channel};
use std::time::Instant;

/// Largest number of waiting jobs.
const WAITING: usize = 64;
/// Largest configuration of a robot, bytes; that of the examples has 20 kB.
const CONFIGURATION: u64 = 4 << 20;

/// A job of the disk.
#[derive(Debug)]
pub(crate) enum Job {
    /// Lists the finished runs; with the folder of the present run.
    Runs(Option<PathBuf>),
    /// Lists the files of a run.
    Files(Option<PathBuf>, String),
    /// Opens a file of a run.
    Open(Option<PathBuf>, String, String),
    /// Makes files of a run.
    Make(Option<PathBuf>, String, RunFiles),
    /// Deletes a run.
    Remove(Option<PathBuf>, String),
    /// Removes what is left of runs whose deletion was interrupted.
    Sweep,
    /// Finds what is wrong with the machine for this system file, whose robot has this supervisor.
    Doctor(PathBuf, Option<u32>),
    /// Stores the robot file of this system file, whose robot has this domain, as was asked for at this instant.
    RobotFile { system: PathBuf, domain: String, texts: Box<RobotTexts>, asked: Instant },
    /// Reads the configuration of a run.
    Configuration(PathBuf),
    /// Starts or stops the unit of a plug-in.
    Plugin { unit: String, plugin: String, verb: Verb },
    /// Stores the text of a mission in a run.
    Mission(PathBuf, String),
    /// Stores changed tokens in this file.
    Tokens(PathBuf, Box<TokenChange>),
}

/// A finished job.
#[derive(Debug)]
pub(crate) enum Outcome {
    /// The call is carried out.
    Done(Ticket, Done),
    /// The mission of this call is stored, and its request can be sent.
    Stored(Ticket),
    /// The tokens are stored, or one sentence says why not.
    Tokens(Box<TokenChange>, Result<(), String>),
}

/// The thread.
pub(crate) struct Disk {
    jobs: SyncSender<(Ticket, Job)>,
    outcomes: Receiver<Outcome>,
    waiting: usize,
}

impl Disk {
    /// Starts the thread for the runs in this folder.
    pub(crate) fn start(runs: PathBuf) -> std::io::Result<Self> {
        let (jobs, todo) = sync_channel(WAITING);
        let (done, outcomes) = channel();
        std::thread::Builder::new().name("disk".to_owned()).spawn(move || work(&runs, &todo, &done))?;
        Ok(Self { jobs, outcomes, waiting: 0 })
    }

    /// Begins a job; returns it if too many wait.
    pub(crate) fn begin(&mut self, ticket: Ticket, job: Job) -> Result<(), Job> {
        match self.jobs.try_send((ticket, job)) {
            Ok(()) => {
                self.waiting += 1;
                Ok(())
            }
            Err(TrySendError::Full((_, job)) | TrySendError::Disconnected((_, job))) => Err(job),
        }
    }

    /// Returns a finished job, if there is one.
    pub(crate) fn poll(&mut self) -> Option<Outcome> {
        let outcome = self.outcomes.try_recv().ok()?;
        self.waiting -= 1;
        Some(outcome)
    }

    /// Returns whether jobs are being done.
    pub(crate) fn is_busy(&self) -> bool {
        self.waiting > 0
    }
}

fn work(folder: &std::path::Path, jobs: &Receiver<(Ticket, Job)>, done: &Sender<Outcome>) {
    while let Ok((ticket, job)) = jobs.recv() {
        let reply = |reply| Done::Reply(Box::new(reply), Vec::new(), None);
        let answered = |reason: Reason| Done::Answer(Box::new(reason.answer()));
        let no_run = |run: &str| answered(Reason::NoFinishedRun { run: detail(run) });
        let outcome = match job {
            Job::Mission(run, text) => match store(&run, &text) {
                Ok(()) => Outcome::Stored(ticket),
                Err(reason) => Outcome::Done(ticket, answered(reason)),
            },
            Job::Tokens(file, change) => {
                let stored = change.tokens().write(&file);
                Outcome::Tokens(change, stored)
            }
            Job::Plugin { unit, plugin, verb } => {
                Outcome::Done(ticket, answered(plugin::carry_out(&unit, &plugin, verb)))
            }
            Job::Runs(present) => {
                let (runs, disk) = (runs::list(folder, present.as_deref()), runs::disk(folder));
                Outcome::Done(ticket, reply(Reply::Runs { id: 0, runs, disk }))
            }
            Job::Make(present, run, what) => {
                Outcome::Done(ticket, changed(make::make(folder, present.as_deref(), &run, what)))
            }
            Job::Remove(present, run) => Outcome::Done(ticket, changed(make::remove(folder, present.as_deref(), &run))),
            Job::Sweep => {
                make::sweep(folder);
                Outcome::Done(ticket, changed(Ok(())))
            }
            Job::Files(present, run) => {
                let files = runs::files(folder, present.as_deref(), &run);
                Outcome::Done(ticket, files.map_or_else(|| no_run(&run), |files| reply(Reply::Files { id: 0, files })))
            }
            Job::Open(present, run, name) => {
                let file = runs::files(folder, present.as_deref(), &run).map(|files| find(files, &name));
                Outcome::Done(
                    ticket,
                    match file {
                        None => no_run(&run),
                        Some(None) => answered(Reason::NoRunFile { run: detail(&run), file: detail(&name) }),
                        Some(Some(file)) => match runs::open(folder, &run, &file) {
                            Ok((descriptor, bytes)) => {
                                Done::Reply(Box::new(Reply::Opened { id: 0, bytes }), Vec::new(), Some(descriptor))
                            }
                            Err(error) => {
                                answered(Reason::DiskRefused { why: detail(format_args!("{name}: {error}")) })
                            }
                        },
                    },
                )
            }
            Job::Doctor(system, supervisor) => {
                let found = make::doctor(&system, supervisor).map(|findings| Reply::Findings { id: 0, findings });
                Outcome::Done(ticket, replied(found))
            }
            Job::RobotFile { system, domain, texts, asked } => {
                Outcome::Done(ticket, answered(robot_file::store(&system, &domain, &texts, asked.elapsed())))
            }
            Job::Configuration(run) => Outcome::Done(
                ticket,
                match runs::configuration(&run, CONFIGURATION) {
                    Ok((files, body)) => Done::Reply(Box::new(Reply::Configuration { id: 0, files }), body, None),
                    Err(why) => answered(Reason::DiskRefused { why: detail(why) }),
                },
            ),
        };
        if done.send(outcome).is_err() {
            return;
        }
    }
}

fn changed(result: Result<(), Box<Reason>>) -> Done {
    replied(result.map(|()| Reply::Done { id: 0 }))
}

fn replied(result: Result<Reply, Box<Reason>>) -> Done {
    match result {
        Ok(reply) => Done::Reply(Box::new(reply), Vec::new(), None),
        Err(reason) => Done::Answer(Box::new(reason.answer())),
    }
}

/// Stores the text of a mission; the rest of what a client may send is not a mission, and is not stored.
#[allow(clippy::result_large_err)] // it is the answer
fn store(run: &std::path::Path, text: &str) -> Result<(), Reason> {
    mission::Mission::parse(text).map_err(|error| error.reason())?;
    config::store_mission(run, text).map(|_| ()).map_err(|error| Reason::DiskRefused { why: detail(error) })
}

fn find(files: Vec<FileRow>, name: &str) -> Option<FileRow> {
    files.into_iter().find(|file| file.name == name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_mission_is_stored() {
        let run = tempfile::tempdir().unwrap();
        let good = "name = \"up\"\n[[leg]]\nline = { to_m = [4.8, 3.0, 0.5] }\n";
        for (text, reason) in [
            ("#!/bin/sh\nrm -r .", 221),
            ("", 221),
            (&good.replace("4.8", "nan"), 224),
            (&good.replace("to_m", "too_m"), 221),
        ] {
            assert_eq!(store(run.path(), text).unwrap_err().code(), reason, "{text}");
        }
        assert!(!run.path().join(config::INBOX).exists());
        store(run.path(), good).unwrap();
        assert_eq!(config::read_mission(run.path(), &config::mission_hash(good)).unwrap(), good);
    }
}
