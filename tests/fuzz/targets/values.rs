#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    vdbake_fuzz::run("values", data);
});
