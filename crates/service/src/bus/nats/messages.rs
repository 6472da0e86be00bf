//! Questions and answers as bytes: the length of a JSON text (u32, little-endian), the text, and the bytes beside it.

use crate::bus::BusError;
use crate::contract::{Answer, Ask, LiveAnswer, LiveAsk, Tile};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// The most bytes of a message, which servers are told (`settings.rs`).
pub(super) const MOST_BYTES: usize = 1 << 20;

/// A question, or a part of the sums of a result.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Question {
    pub ask: Ask,
    /// The place where the bytes beside it begin, and the number of all bytes.
    pub part: Option<(u64, u64)>,
}

/// An answer, or where the next part begins.
#[derive(Debug, Serialize, Deserialize)]
pub(super) enum Reply {
    Answer(Answer),
    Next(u64),
}

/// Puts text and bytes together.
pub(super) fn join(text: &impl Serialize, bytes: &[u8]) -> Vec<u8> {
    let text = serde_json::to_vec(text).expect("messages are JSON");
    let mut message = Vec::with_capacity(size_of::<u32>() + text.len() + bytes.len());
    message.extend_from_slice(&(text.len() as u32).to_le_bytes());
    message.extend_from_slice(&text);
    message.extend_from_slice(bytes);
    message
}

/// The text and the bytes of a message.
pub(super) fn split<T: DeserializeOwned>(message: &[u8]) -> Result<(T, &[u8]), BusError> {
    let unreadable = |error: String| BusError::Unreadable(error);
    let (length, rest) = message.split_first_chunk().ok_or_else(|| unreadable("it is too short".into()))?;
    let (text, bytes) = rest
        .split_at_checked(u32::from_le_bytes(*length) as usize)
        .ok_or_else(|| unreadable("it ends too early".into()))?;
    let text = serde_json::from_slice(text).map_err(|error| unreadable(error.to_string()))?;
    Ok((text, bytes))
}

/// The kind in the subject of a question, one of [`super::subjects::QUESTIONS`].
pub(super) fn kind(ask: &Ask) -> &'static str {
    match ask {
        Ask::Join(_) => "join",
        Ask::Report(_) => "report",
        Ask::Leave => "leave",
        Ask::Lease(_) => "lease",
        Ask::GiveBack(_) => "back",
        Ask::Files(..) => "files",
        Ask::File(_) => "file",
        Ask::Result(_) => "result",
        Ask::Failure(_) => "failure",
    }
}

/// An answer as bytes.
pub(super) fn reply(answer: Answer) -> Vec<u8> {
    match answer {
        Answer::File(bytes) => {
            let is_there = bytes.is_some();
            let mut message = join(&Reply::Answer(Answer::File(None)), &[u8::from(is_there)]);
            message.extend_from_slice(&bytes.unwrap_or_default());
            message
        }
        answer => join(&Reply::Answer(answer), &[]),
    }
}

/// An answer from bytes.
pub(super) fn read_reply(message: &[u8]) -> Result<Reply, BusError> {
    let (reply, bytes) = split(message)?;
    Ok(match (reply, bytes) {
        (Reply::Answer(Answer::File(_)), [1, bytes @ ..]) => {
            Reply::Answer(Answer::File(Some(bytes.to_vec())))
        }
        (reply, _) => reply,
    })
}

/// A question with the bytes beside it.
pub(super) fn with_bytes(ask: Ask, bytes: Vec<u8>) -> Ask {
    match ask {
        Ask::Result(mut finished) => {
            finished.sums = Arc::new(bytes);
            Ask::Result(finished)
        }
        ask => ask,
    }
}

/// A question to a worker as bytes.
pub(super) fn live_question(ask: &LiveAsk) -> Vec<u8> {
    join(ask, &[])
}

/// A question to a worker from bytes.
pub(super) fn read_live_question(message: &[u8]) -> Result<LiveAsk, BusError> {
    split(message).map(|(ask, _)| ask)
}

/// A worker's answer as bytes. One that no message can hold is a refusal.
pub(super) fn live_answer(answer: &LiveAnswer) -> Vec<u8> {
    let message = match answer {
        LiveAnswer::Tile(tile) => join(answer, &tile.jpeg),
        answer => join(answer, &[]),
    };
    if message.len() <= MOST_BYTES {
        return message;
    }
    let told = format!("a tile of {} bytes is more than a message holds", message.len());
    join(&LiveAnswer::Refused(told), &[])
}

/// A worker's answer from bytes.
pub(super) fn read_live_answer(message: &[u8]) -> Result<LiveAnswer, BusError> {
    Ok(match split(message)? {
        (LiveAnswer::Tile(tile), jpeg) => LiveAnswer::Tile(Tile { jpeg: Arc::new(jpeg.to_vec()), ..tile }),
        (answer, _) => answer,
    })
}
