//! Another reference: as an operator asks for it, and as a configuration that was read again names it.
//!
//! It is read and checked on a thread of its own, and only then is the tick asked to follow it.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, TryRecvError, channel};

use proto::recording::EventLevel;
use proto::reference::{Reference, ReferenceError};

use super::answers::one_line;
use super::reach::Carried;
use super::{Asked, Desk, Step, What};
use crate::machine::clock::now_ns;
use crate::operator::mailbox::{Fate, Request, Ticket};
use crate::operator::operator_protocol::{EFFECT_TIME, READ_TIME};
use crate::operator::peer::Peer;
use crate::operator::reference_limits::examine;
use crate::reload::Reloaded;
use crate::replay::run_file::attached;
use crate::session::session_recorder::attachment;

/// A reference that is being read.
pub(super) struct Reading {
    from: Receiver<Result<Reference, String>>,
    name: String,
}

/// A reference that the tick is asked to follow.
pub(super) struct Following {
    ticket: Ticket,
    name: String,
    /// Text for the recording once the tick has taken it.
    csv: String,
    reference: Arc<Reference>,
    /// Lines on it that a person should know.
    remarks: Vec<String>,
}

/// A reference as a configuration names it: another file, or other rows in it, make it another one.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Configured {
    name: String,
    identity: u64,
}

impl Configured {
    pub(super) fn of(name: &str, reference: &Reference) -> Self {
        Configured { name: name.to_owned(), identity: reference.identity() }
    }
}

impl Desk {
    pub(super) fn begin_reference(&mut self, file: PathBuf, csv: Option<String>, asked: Asked) -> Step {
        if self.reading {
            return self.over("reference", asked.peer, Err("another reference is being read; try again".to_owned()));
        }
        let name = file.display().to_string();
        match read_aside(file, csv) {
            Ok(from) => {
                self.reading = true;
                // Of its time the tick's part comes after reading.
                asked.taking(READ_TIME).pending(What::Reading(Reading { from, name }))
            }
            Err(why) => self.over("reference", asked.peer, Err(why)),
        }
    }

    pub(super) fn look_at_reading(&mut self, reading: Reading, asked: Asked) -> Step {
        let late = asked.is_late();
        match reading.from.try_recv() {
            Ok(read) => self.reference_read(read, reading.name, asked),
            Err(TryRecvError::Empty) if !late => asked.pending(What::Reading(reading)),
            Err(_) => {
                // The thread that reads may hang in a file system; its answer goes nowhere.
                self.reading = false;
                let why = format!("{}: it could not be read within {} ms", reading.name, READ_TIME.as_millis());
                self.over("reference", asked.peer, Err(why))
            }
        }
    }

    fn reference_read(&mut self, read: Result<Reference, String>, name: String, asked: Asked) -> Step {
        self.reading = false;
        let checked = read.and_then(|r| match examine(&r, &self.options.safety, &self.options.reference) {
            Ok(remarks) => Ok((r, about(&name, remarks))),
            Err(why) => Err(format!("{name}: {why}")),
        });
        let (reference, remarks) = match checked {
            Ok(checked) => checked,
            Err(why) => {
                self.record("reference", asked.peer, &Err(why.clone()));
                let mut reply = self.reply(Err(why));
                reply.bad_input = true;
                return Step::Done(Box::new(reply));
            }
        };
        let (csv, kept) = (reference.to_csv(), Arc::new(reference.clone()));
        // It moves nothing on a rig that was disarmed while it was read: whoever arms follows the newest.
        match self.ask_tick(Request::Reference(Box::new(reference)), self.options.mailbox.stops()) {
            Ok(ticket) => {
                let following = Following { ticket, name, csv, reference: kept, remarks };
                asked.taking(EFFECT_TIME).pending(What::Following(following))
            }
            Err(why) => self.over("reference", asked.peer, Err(why)),
        }
    }

    pub(super) fn look_at_following(&mut self, following: Following, asked: Asked) -> Step {
        let late = asked.is_late();
        let fate = self.options.mailbox.fate(following.ticket);
        if fate == Fate::Waiting && !late {
            return asked.pending(What::Following(following));
        }
        let what = format!("reference {}", following.name);
        if fate == Fate::Taken || (fate == Fate::Waiting && !self.options.mailbox.withdraw(following.ticket)) {
            self.reference_taken(&following.name, following.csv, following.reference);
            return self.over_remarking(Carried::Reference, &what, following.remarks, asked);
        }
        let why =
            if fate == Fate::Fell { self.why_fell(asked) } else { format!("no tick took it; {}", self.no_session()) };
        self.over(&what, asked.peer, Err(why))
    }

    /// The client that asked for a reference has left.
    pub(super) fn leave_following(&mut self, following: Following, peer: Peer) {
        let outcome = self.withdrawn(following.ticket);
        let what = format!("reference {}", following.name);
        if outcome.is_ok() {
            self.record_reach_later(Arc::clone(&following.reference));
            self.reference_taken(&following.name, following.csv, following.reference);
        }
        self.record(&what, peer, &outcome);
    }

    /// Takes over the references of configurations that were read again; never while the rig is controlled, and never one
    /// that the limits in force do not allow.
    pub fn take_reloads(&mut self) {
        while let Ok(Reloaded { reference, reference_name: name, .. }) = self.options.reloads.try_recv() {
            self.refresh();
            let new = Configured::of(&name, &reference);
            // Where the configuration names the same one as before, an operator's stays.
            if self.configured.as_ref() == Some(&new) {
                continue;
            }
            let is_followed = self.options.followed.as_ref().is_some_and(|f| f.identity() == new.identity);
            if is_followed && self.options.running.reference == one_line(&name) {
                self.configured = Some(new);
                continue;
            }
            let (level, text) = match self.take_over(&name, reference) {
                Ok(remarks) => {
                    self.configured = Some(new);
                    remarks.iter().for_each(|remark| self.note_remark(remark));
                    (EventLevel::Info, format!("reference {name} taken over"))
                }
                // It is tried again when the file is read the next time.
                Err(why) => (EventLevel::Warning, format!("reference {name} not taken over: {why}")),
            };
            self.options.notes.note(now_ns(), level, "reload", text);
        }
    }

    /// Has the tick follow a reference that a configuration names; answers what a person should know of it; what the
    /// model says of it is recorded later. It is judged by the limits in force: others that came in the same file wait for a restart.
    fn take_over(&mut self, name: &str, reference: Reference) -> Result<Vec<String>, String> {
        let remarks = examine(&reference, &self.options.safety, &self.options.reference).map_err(|why| {
            format!("{why}, or restart: until then [safety] and reference.repeat stay as they were at the start")
        })?;
        let (csv, kept) = (reference.to_csv(), Arc::new(reference.clone()));
        let stands_by = self.live_status().is_some_and(|status| !status.state.is_controlling());
        let mailbox = &self.options.mailbox;
        let request = Request::Reference(Box::new(reference));
        if !stands_by || mailbox.ask(request, u64::MAX, mailbox.stops()).is_err() {
            return Err(
                "that needs a session and a rig that is not controlled; send SIGHUP again then, or `controller reference FILE` at any time"
                    .to_owned(),
            );
        }
        self.record_reach_later(Arc::clone(&kept));
        self.reference_taken(name, csv, kept);
        Ok(about(name, remarks))
    }

    /// The tick follows another reference: those who ask are told, and the recording holds it.
    fn reference_taken(&mut self, name: &str, csv: String, reference: Arc<Reference>) {
        self.options.running.reference = one_line(name);
        self.options.followed = Some(reference);
        self.options.notes.attach(attachment(attached::REFERENCE, "text/csv", csv));
    }
}

/// Remarks with the reference that they are about.
fn about(name: &str, remarks: Vec<String>) -> Vec<String> {
    remarks.into_iter().map(|remark| format!("reference {name}: {remark}")).collect()
}

/// Reads and checks a reference on a thread of its own: a file system that hangs holds nobody else.
fn read_aside(file: PathBuf, csv: Option<String>) -> Result<Receiver<Result<Reference, String>>, String> {
    let (answer, from) = channel();
    let work = move || {
        let name = file.display().to_string();
        let read = match csv {
            // The text is the client's own, so it may be quoted back.
            Some(text) => Reference::parse(&name, text.as_bytes()).map_err(|e| e.to_string()),
            None => Reference::read(&file).map_err(|error| without_cells(&file, &error)),
        };
        // Who asked may have gone.
        let _ = answer.send(read);
    };
    std::thread::Builder::new()
        .name("reference".to_owned())
        .spawn(work)
        .map_err(|e| format!("no thread can be started to read it: {e}"))?;
    Ok(from)
}

/// Problem of a file that the daemon read with rights of its own: where, never what stands there.
fn without_cells(file: &Path, error: &ReferenceError) -> String {
    if let ReferenceError::Read { .. } = error {
        return error.to_string();
    }
    let name = file.display().to_string();
    let text = error.to_string();
    let place = text
        .strip_prefix(&format!("{name}: "))
        .and_then(|rest| rest.split_once(": "))
        .map(|(place, _)| place)
        .filter(|place| place.starts_with("line "));
    // `line 3, column 2 (name)`: the name comes out of the file, too.
    let place = place.and_then(|place| place.split(" (").next()).map(|place| format!(", {place}")).unwrap_or_default();
    format!("{name}{place}: no reference that can be followed; needed is CSV with time_s,ref_pos_kpa,ref_neg_kpa")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_of_somebody_else_is_not_read_out() {
        let folder = std::env::temp_dir().join(format!("desk-cells-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        for (text, place) in [
            ("root:$6$secret:19000:0:99999:7:::\n", ""),
            ("secret,other\n1,2\n", ""),
            ("time_s,ref_pos_kpa,ref_neg_kpa\n0,secret,-70\n", "line 2, column 2"),
            ("secret;x;y\n1;2;3\n", ""),
            ("time_s,secret,secret\n0,1,2\n", ""),
        ] {
            let file = folder.join("shadow");
            std::fs::write(&file, text).unwrap();
            let said = without_cells(&file, &Reference::read(&file).unwrap_err());
            assert!(!said.contains("secret") && said.contains(place) && !said.contains('\n'), "{said}");
        }
        std::fs::remove_dir_all(folder).unwrap();
    }
}
