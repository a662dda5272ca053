// How often a test repeats something for statistics' sake.
#pragma once

namespace wheelwright::test {

// `number`; a tenth of it where the sanitizers watch, which are after other mistakes and slow.
constexpr int seeds(int number) {
#ifdef WHEELWRIGHT_SANITIZED
    return number < 10 ? 1 : number / 10;
#else
    return number;
#endif
}

// False where the sanitizers watch: for verdicts that need all the seeds.
constexpr bool all_seeds() {
#ifdef WHEELWRIGHT_SANITIZED
    return false;
#else
    return true;
#endif
}

}  // namespace wheelwright::test
