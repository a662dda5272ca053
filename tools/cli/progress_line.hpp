// How far a campaign is: for commands that run many trials.
#pragma once

#include <unistd.h>

#include <algorithm>
#include <cstddef>
#include <cstdio>
#include <string>

namespace wheelwright::tools {

struct CampaignProgress {
    std::size_t done = 0;  // > 0 when it is told
    std::size_t all = 0;
    double elapsed_s = 0;
    std::string last;  // one line about the last trial
};

// A line that is drawn again on a terminal, and now and then one elsewhere.
class ProgressLine {
  public:
    ProgressLine() : terminal_(::isatty(STDOUT_FILENO) != 0) {}
    ~ProgressLine() {
        if (terminal_ && drawn_) std::printf("\r\033[K");
        std::fflush(stdout);
    }
    ProgressLine(const ProgressLine&) = delete;
    ProgressLine& operator=(const ProgressLine&) = delete;

    void operator()(const CampaignProgress& now) {
        const double left_s =
            now.elapsed_s / static_cast<double>(now.done) * static_cast<double>(now.all - now.done);
        const std::size_t tenth = std::max<std::size_t>(1, now.all / 10);
        if (terminal_) {
            std::printf("\r\033[K  %zu of %zu, %.0f s to go  %s", now.done, now.all, left_s,
                        now.last.c_str());
        } else if (now.done % tenth == 0 || now.done == now.all) {
            std::printf("  %zu of %zu, %.0f s to go\n", now.done, now.all, left_s);
        }
        drawn_ = true;
        std::fflush(stdout);
    }

  private:
    bool terminal_;
    bool drawn_ = false;
};

}  // namespace wheelwright::tools
