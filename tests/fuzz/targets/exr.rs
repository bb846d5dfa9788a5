#![no_main]

libfuzzer_sys::fuzz_target!(
    // The reader turns the decoder's panics into errors, and libFuzzer's hook would end the process before that.
    init: std::panic::set_hook(Box::new(|_| ())),
    |data: &[u8]| {
        vdbake_fuzz::run("exr", data);
    }
);
