// A test framework of one page: TEST(name) { CHECK(...); } and a count at the end.
#ifndef CHECK_H
#define CHECK_H

#include <cmath>
#include <cstdio>
#include <vector>

struct TestCase {
    const char *name;
    void (*body)();
};

std::vector<TestCase> &all_tests();
extern int failures;

struct Registration {
    Registration(const char *name, void (*body)()) { all_tests().push_back({name, body}); }
};

#define TEST(name)                                            \
    static void test_##name();                                \
    static const Registration registration_##name(#name, test_##name); \
    static void test_##name()

#define CHECK(condition)                                                        \
    do {                                                                        \
        if (!(condition)) {                                                     \
            std::printf("%s:%d: not true: %s\n", __FILE__, __LINE__, #condition); \
            ++failures;                                                         \
        }                                                                       \
    } while (0)

#define CHECK_EQUAL(actual, expected)                                                  \
    do {                                                                               \
        const double got = static_cast<double>(actual), want = static_cast<double>(expected); \
        if (got != want) {                                                             \
            std::printf("%s:%d: %s is %.9g, not %.9g\n", __FILE__, __LINE__, #actual, got, want); \
            ++failures;                                                                \
        }                                                                              \
    } while (0)

#define CHECK_NEAR(actual, expected, tolerance)                                        \
    do {                                                                               \
        const double got = static_cast<double>(actual), want = static_cast<double>(expected); \
        if (!(std::fabs(got - want) <= (tolerance))) {                                 \
            std::printf("%s:%d: %s is %.9g, not %.9g\n", __FILE__, __LINE__, #actual, got, want); \
            ++failures;                                                                \
        }                                                                              \
    } while (0)

#endif  // CHECK_H
