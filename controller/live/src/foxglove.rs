//! The Foxglove websocket protocol, version 1: Foxglove, Lichtblick and PlotJuggler show the run live through it.
//!
//! The server says who it is (`serverInfo`) and what it has (`advertise`); a client subscribes to channels; from then on
//! every message of theirs goes out as a binary frame: `1 · subscription id (u32 LE) · time in ns (u64 LE) · message`.
//! Messages and schemas are those of recordings, so one layout serves for both. Nothing else is offered: a client can
//! neither publish, nor call services, nor set parameters.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use proto::recording::{encode_log_message, encode_tick_message, message_schemas};
use serde_json::{Value, json};

use crate::hub::Hub;
use crate::websocket::{Received, WebSocket, base64};

/// The subprotocols that are spoken, the newer name first.
const PROTOCOLS: [&str; 2] = ["foxglove.sdk.v1", "foxglove.websocket.v1"];
/// Channel of ticks; that of events is the next.
const TICK_CHANNEL: u64 = 1;
/// How long a client's words are waited for between two looks for news: half a tick.
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

/// Serves a client until it goes, or told to stop.
///
/// # Errors
/// The connection fails, or the client breaks the protocol.
pub(crate) fn serve(mut socket: WebSocket, hub: &Arc<Hub>, stop: &AtomicBool) -> io::Result<()> {
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
    while !stop.load(Ordering::Relaxed) {
        match socket.receive(LOOK)? {
            Received::Closed => return Ok(()),
            Received::Text(text) => {
                if let Some(problem) = obey(&text, &mut subscriptions) {
                    socket.text(&json!({"op": "status", "level": 1, "message": problem}).to_string())?;
                }
            }
            Received::Nothing => {}
        }
        for (channel, unix_ns, message) in news(hub, &mut next) {
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
    json!({"op": "advertise", "channels": channels.collect::<Vec<_>>()})
}

/// Does what a client asks; a sentence where that cannot be done.
fn obey(text: &str, subscriptions: &mut Vec<Subscription>) -> Option<String> {
    /// More than a client can want of two channels.
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
                if !(TICK_CHANNEL..=TICK_CHANNEL + 1).contains(&channel) {
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

    #[test]
    fn both_names_of_the_protocol_are_known() {
        assert_eq!(choose("foxglove.websocket.v1"), Some("foxglove.websocket.v1"));
        assert_eq!(choose("x, foxglove.sdk.v1 ,foxglove.websocket.v1"), Some("foxglove.sdk.v1"));
        assert_eq!(choose("chat"), None);
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
