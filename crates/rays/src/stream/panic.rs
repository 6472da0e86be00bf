//! Panics of foreign code, caught where it is called.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};

/// The message of a caught panic. Drops the payload, whose own drop may panic as well.
pub fn panic_message(payload: Box<dyn Any + Send>) -> String {
    let message = if let Some(text) = payload.downcast_ref::<&str>() {
        (*text).to_owned()
    } else if let Some(text) = payload.downcast_ref::<String>() {
        text.clone()
    } else if let Some(Stopped(reason)) = payload.downcast_ref() {
        reason.clone()
    } else {
        "(no message)".to_owned()
    };
    drop_quietly(payload);
    message
}

/// Reason why a user's code cannot go on: the payload of an unwinding that is no bug and prints nothing.
#[derive(Debug)]
pub struct Stopped(pub String);

/// Ends the job whose code calls this, with a reason for people.
#[cold]
pub fn stop_job(reason: String) -> ! {
    resume_unwind(Box::new(Stopped(reason)))
}

/// Drops a value of foreign type. If its drop panics, the panic is caught and its payload leaked.
pub fn drop_quietly<T>(value: T) {
    if let Err(payload) = catch_unwind(AssertUnwindSafe(|| drop(value))) {
        std::mem::forget(payload);
    }
}
