// How a contract suite judges. Under CppUTest a failed expectation fails the test; a program for a guest that
// has no CppUTest defines WHEELWRIGHT_CONTRACT_PLAIN, and failures are printed and counted.
#pragma once

#ifdef WHEELWRIGHT_CONTRACT_PLAIN

#include <cstdio>

namespace wheelwright::contract {
inline int failures = 0;
}

#define EXPECT_THAT(condition)                                                    \
    do {                                                                          \
        if (!(condition)) {                                                       \
            std::printf("%s:%d: not true: %s\n", __FILE__, __LINE__, #condition); \
            ++wheelwright::contract::failures;                                    \
        }                                                                         \
    } while (false)
#define EXPECT_EQUAL(wanted, had) EXPECT_THAT((wanted) == (had))

#else

#include <CppUTest/TestHarness.h>

#define EXPECT_THAT(condition) CHECK(condition)
#define EXPECT_EQUAL(wanted, had) LONGS_EQUAL(static_cast<long long>(wanted), static_cast<long long>(had))

#endif
