//! The Foxglove websocket protocol, version 1: Foxglove, Lichtblick and PlotJuggler show the run live through it.
//!
//! The server says who it is (`serverInfo`) and what it has (`advertise`); a client subscribes to channels; from then on
//! every message of theirs goes out as a binary frame: `1 · subscription id (u32 LE) · time in ns (u64 LE) · message`.
//! Ticks and events have the schemas of recordings, so one layout serves for both. The third channel is the daemon's state, as
//! JSON: it is told once a second and whenever it changes, with or without ticks. Nothing else is offered: a client can neither
//! publish, nor call services, nor set parameters. A client that has gone without a word is found by pings that it does not
//! answer.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant, SystemTime};

use proto::recording::{encode_log_message, encode_tick_message, message_schemas, unix_ns};
use serde_json::{Value, json};

use crate::hub::Hub;
use crate::state_json::daemon;
use crate::websocket::{Received, WebSocket, base64};

/// The subprotocols that are spoken, the newer name first.
const PROTOCOLS: [&str; 2] = ["foxglove.sdk.v1", "foxglove.websocket.v1"];
/// Channel of ticks; that of events is the next.
const TICK_CHANNEL: u64 = 1;
/// Channel of the daemon's state, behind those of ticks and events.
const STATE_CHANNEL: u64 = TICK_CHANNEL + 2;
/// Longest time between two tellings of the state, for it is told although it has not changed.
const STATE_EVERY: Duration = Duration::from_secs(1);
/// Time that a client's words are waited for between two looks for news: half a tick.
const LOOK: Duration = Duration::from_millis(10);

/// The subprotocol to speak, of those that a client offers.
pub(crate) fn choose(offered: &str) -> Option<&'static str> {
    PROTOCOLS.into_iter().find(|known| offered.split(',').any(|name| name.trim() == *known))
}

/// A subscription: the client's number for it, and the channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Subscription {
    id: u32,
    channel: u64,
}

/// Serves a client until it goes, is silent for longer than `silence` although it is pinged, or told to stop.
///
/// # Errors
/// The connection fails, or the client breaks the protocol.
pub(crate) fn serve(mut socket: WebSocket, hub: &Arc<Hub>, silence: Duration, stop: &AtomicBool) -> io::Result<()> {
    let info = json!({
        "op": "serverInfo",
        "name": "controller live",
        "capabilities": [],
        "metadata": hub.lock().about.clone(),
    });
    socket.text(&info.to_string())?;
    socket.text(&advertise().to_string())?;
    let mut subscriptions: Vec<Subscription> = Vec::new();
    // From now on: what was before is in the recording.
    let mut next = hub.lock().next();
    let mut state = ToldState::default();
    while !stop.load(Ordering::Relaxed) {
        socket.keep_alive(silence)?;
        match socket.receive(LOOK)? {
            Received::Closed => return Ok(()),
            Received::Text(text) => {
                if let Some(problem) = obey(&text, &mut subscriptions) {
                    socket.text(&json!({"op": "status", "level": 1, "message": problem}).to_string())?;
                }
                // Whoever has just subscribed is told at once.
                state = ToldState::default();
            }
            Received::Nothing => {}
        }
        let is_asked = subscriptions.iter().any(|subscription| subscription.channel == STATE_CHANNEL);
        let state_news = is_asked.then(|| state.news(hub)).flatten();
        for (channel, unix_ns, message) in news(hub, &mut next).into_iter().chain(state_news) {
            for subscription in subscriptions.iter().filter(|subscription| subscription.channel == channel) {
                let mut frame = Vec::with_capacity(13 + message.len());
                frame.push(1);
                frame.extend_from_slice(&subscription.id.to_le_bytes());
                frame.extend_from_slice(&unix_ns.to_le_bytes());
                frame.extend_from_slice(&message);
                socket.binary(&frame)?;
            }
        }
    }
    Ok(())
}

fn advertise() -> Value {
    let channels = (TICK_CHANNEL..).zip(message_schemas()).map(|(id, schema)| {
        json!({
            "id": id,
            "topic": schema.topic,
            "encoding": "protobuf",
            "schemaName": schema.name,
            "schemaEncoding": "protobuf",
            "schema": base64(&schema.descriptors),
        })
    });
    let state = json!({
        "id": STATE_CHANNEL,
        "topic": "/state",
        "encoding": "json",
        "schemaName": "controller.State",
        "schemaEncoding": "jsonschema",
        "schema": state_schema().to_string(),
    });
    json!({"op": "advertise", "channels": channels.chain([state]).collect::<Vec<_>>()})
}

/// The fields of a message about the state.
fn state_schema() -> Value {
    let text = json!({"type": "string"});
    json!({
        "type": "object",
        "properties": {
            "up": {"type": "boolean"},
            "state": text,
            "fault": text,
            "waits": text,
            "session": {"type": "integer"},
            "age_s": {"type": ["number", "null"]},
            "policy": text,
            "policy_sha256": text,
            "model": text,
            "model_sha256": text,
            "reference": text,
            "recording_problem": text,
            "recording_free_bytes": {"type": ["integer", "null"]},
        },
    })
}

/// The daemon's state as a client was last told it.
#[derive(Default)]
struct ToldState {
    last: Option<(Value, Instant)>,
}

impl ToldState {
    /// The state, where it is another one than a client knows or some time has passed.
    fn news(&mut self, hub: &Hub) -> Option<(u64, u64, Vec<u8>)> {
        let (now, age) = {
            let known = hub.lock();
            (daemon(hub, &known), known.age())
        };
        if self.last.as_ref().is_some_and(|(told, at)| *told == now && at.elapsed() < STATE_EVERY) {
            return None;
        }
        let mut message = now.clone();
        message["age_s"] = json!(age.map(|age| age.as_secs_f64()));
        self.last = Some((now, Instant::now()));
        Some((STATE_CHANNEL, unix_ns(SystemTime::now()), message.to_string().into_bytes()))
    }
}

/// Does what a client asks; a sentence where that cannot be done.
fn obey(text: &str, subscriptions: &mut Vec<Subscription>) -> Option<String> {
    /// More than a client can want of three channels.
    const MOST: usize = 64;
    let Ok(message) = serde_json::from_str::<Value>(text) else {
        return Some("not a message of the protocol".to_owned());
    };
    let list = |key: &str| message[key].as_array().cloned().unwrap_or_default();
    let number = |value: &Value| value.as_u64().and_then(|number| u32::try_from(number).ok());
    match message["op"].as_str() {
        Some("subscribe") => {
            for wanted in list("subscriptions") {
                let (Some(id), Some(channel)) = (number(&wanted["id"]), wanted["channelId"].as_u64()) else { continue };
                subscriptions.retain(|subscription| subscription.id != id);
                if !(TICK_CHANNEL..=STATE_CHANNEL).contains(&channel) {
                    return Some(format!("there is no channel {channel}"));
                }
                if subscriptions.len() < MOST {
                    subscriptions.push(Subscription { id, channel });
                }
            }
            None
        }
        Some("unsubscribe") => {
            let gone: Vec<u32> = list("subscriptionIds").iter().filter_map(number).collect();
            subscriptions.retain(|subscription| !gone.contains(&subscription.id));
            None
        }
        other => Some(format!("{} is not offered: this server is read-only", other.unwrap_or("a message without op"))),
    }
}

/// Ticks and events since a client's last look, in their order.
fn news(hub: &Hub, next: &mut u64) -> Vec<(u64, u64, Vec<u8>)> {
    let known = hub.lock();
    let mut found = Vec::new();
    for seen in known.ticks.iter().rev().take_while(|seen| seen.number >= *next) {
        let mut message = Vec::new();
        encode_tick_message(&seen.what, &mut message);
        found.push((seen.number, (TICK_CHANNEL, seen.unix_ns, message)));
    }
    for seen in known.events.iter().rev().take_while(|seen| seen.number >= *next) {
        let mut message = Vec::new();
        encode_log_message(seen.unix_ns, seen.what.level, &seen.what.part, &seen.what.message, &mut message);
        found.push((seen.number, (TICK_CHANNEL + 1, seen.unix_ns, message)));
    }
    *next = known.next();
    found.sort_by_key(|(number, _)| *number);
    found.into_iter().map(|(_, message)| message).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use flight::CodeNames;
    use proto::stream::{DaemonState, Message};

    #[test]
    fn both_names_of_the_protocol_are_known() {
        assert_eq!(choose("foxglove.websocket.v1"), Some("foxglove.websocket.v1"));
        assert_eq!(choose("x, foxglove.sdk.v1 ,foxglove.websocket.v1"), Some("foxglove.sdk.v1"));
        assert_eq!(choose("chat"), None);
    }

    #[test]
    fn the_state_is_told_at_once_when_it_changes_and_without_any_tick() {
        let hub = Hub::new(CodeNames { state: |_| "connecting", fault: |_| "link lost" });
        hub.link(Ok(()));
        let mut told = ToldState::default();
        let mut news = |hub: &Hub| {
            let (channel, _, message) = told.news(hub)?;
            assert_eq!(channel, STATE_CHANNEL);
            Some(serde_json::from_slice::<Value>(&message).unwrap())
        };
        assert_eq!(news(&hub).unwrap()["up"], false);
        hub.take(Message::State(DaemonState { state: 6, fault: 7, age_ms: Some(10_900), ..DaemonState::default() }));
        let state = news(&hub).unwrap();
        assert_eq!((&state["state"], &state["fault"]), (&json!("connecting"), &json!("link lost")));
        assert!(state["age_s"].as_f64().unwrap() >= 10.9, "{state}");
        hub.link(Err("the daemon ended".to_owned()));
        let state = news(&hub).unwrap();
        assert!(state["up"] == false && state["fault"] == "the daemon ended", "{state}");
        let channels = advertise();
        assert!(channels["channels"].as_array().unwrap().iter().any(|channel| channel["topic"] == "/state"));
    }

    #[test]
    fn subscriptions_come_and_go_and_nothing_else_is_offered() {
        let mut all = Vec::new();
        let subscribe = r#"{"op":"subscribe","subscriptions":[{"id":7,"channelId":1},{"id":8,"channelId":2}]}"#;
        assert_eq!(obey(subscribe, &mut all), None);
        assert_eq!(all, [Subscription { id: 7, channel: 1 }, Subscription { id: 8, channel: 2 }]);
        assert_eq!(obey(r#"{"op":"unsubscribe","subscriptionIds":[7]}"#, &mut all), None);
        assert_eq!(all.len(), 1);
        for refused in [
            r#"{"op":"advertise","channels":[]}"#,
            r#"{"op":"subscribe","subscriptions":[{"id":1,"channelId":99}]}"#,
            "{}",
            "not json",
        ] {
            assert!(obey(refused, &mut all).is_some(), "{refused}");
        }
    }
}
