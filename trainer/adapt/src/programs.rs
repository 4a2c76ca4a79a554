//! Commands as children: shown as a person would type them, stopped with their caller, bounded in time.

use std::ffi::OsStr;
use std::io::Read;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use proto::parent_process::ends_with_this;
use rustix::process::{Pid, Signal, kill_process};

use crate::AdaptError;

/// Between two looks at a child.
const LOOK: Duration = Duration::from_millis(50);
/// Exit status of a command that a SIGINT stopped before it was done.
const BY_SIGINT: i32 = 130;

/// Whoever looks on and decides.
pub trait Console {
    /// A step begins: its number of so many, and what it does.
    fn step(&mut self, number: usize, of: usize, what: &str);
    /// A command is run.
    fn command(&mut self, command: &str);
    /// A line that a person should know.
    fn say(&mut self, text: &str);
    /// Still at it: what, for how long, and how long it may take.
    fn waiting(&mut self, what: &str, elapsed: Duration, most: Option<Duration>);
    /// Tells whether to stop.
    fn stop(&self) -> bool;
    /// Asks the operator; without a terminal the answer is no.
    fn ask(&mut self, question: &str) -> bool;
}

/// The two programs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Programs {
    /// `controller`.
    pub controller: PathBuf,
    /// `trainer`.
    pub trainer: PathBuf,
}

/// Output of a command, and how it ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Said {
    /// Exit status; nothing where a signal ended it.
    pub status: Option<i32>,
    /// Standard output.
    pub out: String,
    /// Standard error.
    pub err: String,
}

impl Said {
    /// The last line of what it said, of standard error first.
    pub fn last_line(&self) -> String {
        let last =
            |text: &str| text.lines().rev().find(|line| !line.trim().is_empty()).map(|line| line.trim().to_owned());
        last(&self.err).or_else(|| last(&self.out)).unwrap_or_else(|| format!("exit status {:?}", self.status))
    }
}

/// A command being put together.
#[derive(Debug)]
pub struct Step<'a> {
    program: &'a Path,
    name: &'static str,
    arguments: Vec<String>,
    /// After so long it is asked to end, by SIGINT, and what it then leaves is taken: that it was stopped is no failure then.
    pub most: Option<Duration>,
}

impl Programs {
    /// A command of `controller`.
    pub fn controller<I: IntoIterator<Item = S>, S: AsRef<OsStr>>(&self, arguments: I) -> Step<'_> {
        Step::new(&self.controller, "controller", arguments)
    }

    /// A command of `trainer`.
    pub fn trainer<I: IntoIterator<Item = S>, S: AsRef<OsStr>>(&self, arguments: I) -> Step<'_> {
        Step::new(&self.trainer, "trainer", arguments)
    }
}

impl<'a> Step<'a> {
    fn new<I: IntoIterator<Item = S>, S: AsRef<OsStr>>(program: &'a Path, name: &'static str, arguments: I) -> Self {
        let arguments = arguments.into_iter().map(|a| a.as_ref().to_string_lossy().into_owned()).collect();
        Step { program, name, arguments, most: None }
    }

    /// Ends the command after so long.
    #[must_use]
    pub fn at_most(mut self, most: Duration) -> Self {
        self.most = Some(most);
        self
    }

    /// The command as a person would type it.
    pub fn text(&self) -> String {
        let quoted = |a: &String| if a.contains(char::is_whitespace) { format!("'{a}'") } else { a.clone() };
        std::iter::once(self.name.to_owned()).chain(self.arguments.iter().map(quoted)).collect::<Vec<_>>().join(" ")
    }

    /// Shows it and runs it to its end.
    ///
    /// # Errors
    /// It cannot be started, or the user stops everything.
    pub fn run(&self, console: &mut dyn Console) -> Result<Said, AdaptError> {
        console.command(&self.text());
        self.run_silently(console)
    }

    /// Runs it to its end; for questions that are asked again and again.
    ///
    /// A Ctrl-C on the terminal goes to a whole process group: in one of its own the command ends where the console
    /// stops it, and a second Ctrl-C does not end what puts everything back.
    ///
    /// # Errors
    /// As [`Step::run`].
    pub fn run_silently(&self, console: &mut dyn Console) -> Result<Said, AdaptError> {
        let started = ends_with_this(&mut Command::new(self.program))
            .process_group(0)
            .args(&self.arguments)
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn();
        let mut child = started.map_err(|source| AdaptError::Start { command: self.text(), source })?;
        let [out, err] = [collect(child.stdout.take()), collect(child.stderr.take())];
        let ended = self.wait(&mut child, console);
        let (out, err) = (out.text(), err.text());
        Ok(Said { status: ended?, out, err })
    }

    fn wait(&self, child: &mut Child, console: &mut dyn Console) -> Result<Option<i32>, AdaptError> {
        let began = Instant::now();
        let (mut is_stopping, mut is_over_time) = (false, false);
        let lost = |source| AdaptError::Start { command: self.text(), source };
        loop {
            if let Some(status) = child.try_wait().map_err(lost)? {
                // A Ctrl-C in the moment in which it is started still reaches it.
                let is_stopped = is_stopping || (status.code().is_none() && console.stop());
                let is_over = is_over_time && status.code() == Some(BY_SIGINT);
                let status = if is_over { Some(0) } else { status.code() };
                return if is_stopped { Err(AdaptError::Stopped) } else { Ok(status) };
            }
            if console.stop() && !is_stopping {
                is_stopping = true;
                signal(child, Signal::TERM);
            }
            if self.most.is_some_and(|most| began.elapsed() > most) && !is_over_time {
                is_over_time = true;
                signal(child, Signal::INT);
            }
            console.waiting(
                &format!("{} {}", self.name, self.arguments.first().map_or("", String::as_str)),
                began.elapsed(),
                self.most,
            );
            std::thread::sleep(LOOK);
        }
    }

    /// Runs it, and takes any exit status but 0 for a failure.
    ///
    /// # Errors
    /// As [`Step::run`], and its last line where it fails.
    pub fn done(&self, console: &mut dyn Console) -> Result<Said, AdaptError> {
        self.require_success(self.run(console)?)
    }

    /// Takes any exit status but 0 for a failure.
    ///
    /// # Errors
    /// Last line of it where it failed.
    pub(crate) fn require_success(&self, said: Said) -> Result<Said, AdaptError> {
        match said.status {
            Some(0) => Ok(said),
            _ => Err(AdaptError::Failed { command: self.text(), said: said.last_line() }),
        }
    }
}

/// Sends a signal to a child that has not been waited for.
pub(crate) fn signal(child: &Child, signal: Signal) {
    if let Some(pid) = Pid::from_raw(child.id().cast_signed()) {
        // A child that has just ended needs no signal.
        let _ = kill_process(pid, signal);
    }
}

/// Bytes that a pipe brings, collected beside.
struct Collected {
    text: Arc<Mutex<Vec<u8>>>,
    thread: Option<JoinHandle<()>>,
}

impl Collected {
    fn text(mut self) -> String {
        if let Some(thread) = self.thread.take() {
            // A reader that failed has nothing more to bring.
            let _ = thread.join();
        }
        String::from_utf8_lossy(&self.text.lock().unwrap_or_else(PoisonError::into_inner)).into_owned()
    }
}

fn collect(pipe: Option<impl Read + Send + 'static>) -> Collected {
    let text = Arc::new(Mutex::new(Vec::new()));
    let to = Arc::clone(&text);
    let thread = pipe.map(|mut pipe| {
        std::thread::spawn(move || {
            let mut piece = [0; 4096];
            while let Ok(read) = pipe.read(&mut piece) {
                if read == 0 {
                    return;
                }
                let read = piece.get(..read).unwrap_or_default();
                to.lock().unwrap_or_else(PoisonError::into_inner).extend_from_slice(read);
            }
        })
    });
    Collected { text, thread }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::judging::tests::Said as Console;

    /// The terminal sends a Ctrl-C to the group of the program that is in front: a child there would end in the midst of
    /// what is put back.
    #[test]
    fn a_command_is_no_part_of_the_group_that_a_ctrl_c_ends() {
        let programs = Programs { controller: "sh".into(), trainer: "sh".into() };
        let group = programs.controller(["-c", "cut -d ' ' -f 5 /proc/$$/stat; echo $$"]);
        let said = group.done(&mut Console::default()).unwrap();
        let [group, own] = said.out.lines().collect::<Vec<_>>()[..] else { panic!("{said:?}") };
        assert_eq!(group, own);
    }

    /// A training that is stopped because its time is over says so by its exit status, and what it leaves is taken all the same.
    #[test]
    fn a_command_whose_time_is_over_has_not_failed() {
        // The shell must have set its trap by then, also on a busy machine.
        const PATIENCE_MS: u64 = 2000;
        let programs = Programs { controller: "sh".into(), trainer: "sh".into() };
        let ended_with = |status: i32, most_ms: u64| {
            let script = format!("trap 'echo left; exit {status}' INT; while :; do sleep 0.01; done");
            let step = programs.trainer(["-c", &script]).at_most(Duration::from_millis(most_ms));
            step.done(&mut Console::default())
        };
        assert_eq!(ended_with(130, PATIENCE_MS).unwrap().out, "left\n");
        let failed = ended_with(1, PATIENCE_MS);
        assert!(
            matches!(&failed, Err(AdaptError::Failed { said, .. }) if said == "left"),
            "a failure stays one: {failed:?}"
        );
        // It was not asked to stop.
        let by_itself = programs.trainer(["-c", "exit 130"]).at_most(Duration::from_secs(60));
        assert!(matches!(by_itself.done(&mut Console::default()), Err(AdaptError::Failed { .. })));
    }
}
