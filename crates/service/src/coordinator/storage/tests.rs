//! A storage that does not answer, or refuses.

use super::*;
use std::ops::Range;
use std::sync::Barrier;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering::SeqCst};

/// A storage that is silent, or has no right to anything, and counts requests.
#[derive(Default)]
struct Broken {
    is_silent: AtomicBool,
    count: AtomicUsize,
    /// Where a request waits twice, if it does.
    held: Option<Barrier>,
}

impl Broken {
    fn fail<T>(&self) -> Result<T, ObjectError> {
        self.count.fetch_add(1, SeqCst);
        for barrier in self.held.iter().chain(&self.held) {
            barrier.wait();
        }
        let silent = self.is_silent.load(SeqCst);
        Err(if silent { ObjectError::Silent("quiet".into()) } else { ObjectError::Refused("no".into()) })
    }
}

impl Objects for Arc<Broken> {
    fn put(&self, _: &str, _: &mut dyn Read, _: u64, _: &str) -> Result<(), ObjectError> {
        self.fail()
    }

    fn get(&self, _: &str, _: Range<u64>) -> Result<Vec<u8>, ObjectError> {
        self.fail()
    }

    fn size(&self, _: &str) -> Result<u64, ObjectError> {
        self.fail()
    }

    fn delete(&self, _: &str) -> Result<(), ObjectError> {
        self.fail()
    }

    fn list(&self, _: &str) -> Result<Vec<(String, SystemTime)>, ObjectError> {
        self.fail()
    }

    fn sign(&self, _: &str, _: Option<&str>, _: Duration) -> Result<String, ObjectError> {
        self.fail()
    }
}

fn with(objects: &Arc<Broken>) -> (Storage, tempfile::TempDir) {
    let folder = tempfile::tempdir().expect("a folder");
    let ledger = Arc::new(Ledger::open(folder.path()).expect("a ledger"));
    let second = Duration::from_secs(1);
    let options = StorageOptions {
        url: "s3://bucket".into(),
        endpoint: None,
        ca: None,
        insecure: false,
        cache_bytes: 0,
        timeout: second,
        expiry: second,
        scene_rest: second,
    };
    (Storage::of(options, Box::new(Arc::clone(objects)), &ledger), folder)
}

#[test]
fn while_a_storage_is_silent_the_others_are_refused_at_once() {
    let objects = Arc::new(Broken { is_silent: true.into(), ..Broken::default() });
    let (storage, _folder) = with(&objects);
    for _ in 0..3 {
        let told = storage.delete("a").expect_err("it is silent").to_string();
        assert_eq!(told, "the storage s3://bucket cannot be used: quiet");
    }
    assert_eq!(objects.count.load(SeqCst), 1);
    assert!(storage.is_in_trouble() && storage.check().is_err());
    // One that answers is asked each time.
    objects.is_silent.store(false, SeqCst);
    storage.state().silent = None;
    for _ in 0..3 {
        assert!(storage.delete("a").is_err());
    }
    assert_eq!(objects.count.load(SeqCst), 4);
}

#[test]
fn one_tries_a_silent_storage_again_and_no_other_waits_for_it() {
    let held = Some(Barrier::new(2));
    let objects = Arc::new(Broken { is_silent: true.into(), held, ..Broken::default() });
    let (storage, _folder) = with(&objects);
    let long_ago = Instant::now().checked_sub(2 * ANSWER_LASTS).expect("a time");
    storage.state().silent = Some((long_ago, "quiet".into()));
    std::thread::scope(|scope| {
        scope.spawn(|| storage.delete("a").expect_err("it is silent"));
        let barrier = objects.held.as_ref().expect("one");
        // It is asked by now, and answers after the others were refused.
        barrier.wait();
        assert!(storage.delete("b").is_err() && storage.list("c").is_err());
        assert_eq!(objects.count.load(SeqCst), 1);
        barrier.wait();
    });
    assert!(storage.delete("d").is_err());
    assert_eq!(objects.count.load(SeqCst), 1, "it was silent a moment ago");
}
