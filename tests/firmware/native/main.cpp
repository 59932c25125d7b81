// Runs the tests whose names contain the first argument, or all.
#include <cstring>

#include "check.h"

int failures = 0;

std::vector<TestCase> &all_tests() {
    static std::vector<TestCase> tests;
    return tests;
}

int main(int count, char **words) {
    const char *wanted = count > 1 ? words[1] : "";
    int run = 0;
    for (const TestCase &test : all_tests()) {
        if (!std::strstr(test.name, wanted)) continue;
        const int before = failures;
        test.body();
        ++run;
        std::printf("%s %s\n", failures == before ? "ok  " : "FAIL", test.name);
    }
    std::printf("%d tests, %d failed checks\n", run, failures);
    return failures || !run ? 1 : 0;
}
