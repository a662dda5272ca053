// What goes into a page, without a browser: thinning, numbers, escaping. tests/pages/check_page.py sees the
// rest.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <limits>
#include <string>
#include <vector>

#include "tests/pages/sample.hpp"
#include "tools/report/decimate.hpp"
#include "tools/report/format.hpp"
#include "tools/report/page.hpp"

#include <CppUTest/TestHarness.h>

using namespace wheelwright::report;

namespace {

constexpr double kNotANumber = std::numeric_limits<double>::quiet_NaN();

bool holds(const std::vector<std::size_t>& kept, std::size_t index) {
    return std::find(kept.begin(), kept.end(), index) != kept.end();
}

// Distance of a point to the segment a-b.
double distance(double px, double py, double ax, double ay, double bx, double by) {
    const double dx = bx - ax;
    const double dy = by - ay;
    const double square = dx * dx + dy * dy;
    const double along = square > 0 ? std::clamp(((px - ax) * dx + (py - ay) * dy) / square, 0.0, 1.0) : 0.0;
    return std::hypot(px - ax - along * dx, py - ay - along * dy);
}

}  // namespace

TEST_GROUP(Thinning) {
    std::vector<double> x, y;
    void fill(std::size_t size) {
        for (std::size_t i = 0; i < size; ++i) {
            x.push_back(0.01 * static_cast<double>(i) + 3.7);
            y.push_back(std::sin(0.002 * static_cast<double>(i)));
        }
    }
};

TEST(Thinning, PeaksAndEndsOfACurveStay) {
    fill(100000);
    y[54321] = 7.5;
    y[54322] = -9.25;
    const auto kept = thin_curve(x, y, 1000, false);
    CHECK(kept.size() <= 1000);
    CHECK(kept.size() > 500);
    CHECK(std::is_sorted(kept.begin(), kept.end()));
    CHECK(std::adjacent_find(kept.begin(), kept.end()) == kept.end());
    CHECK(holds(kept, 54321));
    CHECK(holds(kept, 54322));
    LONGS_EQUAL(0, kept.front());
    LONGS_EQUAL(99999, kept.back());
}

TEST(Thinning, ShortCurvesStayWhole) {
    fill(900);
    LONGS_EQUAL(900, thin_curve(x, y, 1000, false).size());
}

TEST(Thinning, EveryBreakStaysABreak) {
    fill(50000);
    for (std::size_t i = 20000; i < 30000; ++i) y[i] = kNotANumber;
    const auto kept = thin_curve(x, y, 400, false);
    const auto breaks =
        std::count_if(kept.begin(), kept.end(), [&](std::size_t i) { return std::isnan(y[i]); });
    LONGS_EQUAL(1, breaks);
    CHECK(holds(kept, 19999));
    CHECK(holds(kept, 30000));
}

TEST(Thinning, ALogarithmicAxisKeepsItsFirstDecades) {
    fill(100000);
    for (std::size_t i = 0; i < x.size(); ++i) x[i] = static_cast<double>(i);  // 0 cannot be shown
    const auto kept = thin_curve(x, y, 1000, true);
    CHECK_FALSE(holds(kept, 0));
    for (std::size_t i = 1; i <= 10; ++i) CHECK(holds(kept, i));
    CHECK(kept.size() <= 1000);
}

TEST(Thinning, APathStaysWhereItIs) {
    for (int i = 0; i <= 40000; ++i) {
        const double p = 2 * 3.14159265358979 * i / 10000;
        x.push_back(1.5 * std::sin(p));
        y.push_back(0.75 * std::sin(2 * p));
    }
    const auto kept = thin_path(x, y, 2000);
    CHECK(kept.size() < 600);
    double worst = 0;
    for (std::size_t k = 0; k + 1 < kept.size(); ++k) {
        for (std::size_t i = kept[k]; i <= kept[k + 1]; ++i) {
            worst =
                std::max(worst, distance(x[i], y[i], x[kept[k]], y[kept[k]], x[kept[k + 1]], y[kept[k + 1]]));
        }
    }
    std::printf("\n  %zu of 40001 points, at most %.2f mm off a path of 3 m ", kept.size(), 1000 * worst);
    CHECK(worst <= 3.0 / 3000 * 1.0001);
}

TEST(Thinning, APathOfNoiseIsBounded) {
    for (unsigned i = 0; i < 20000; ++i) {
        x.push_back(static_cast<double>(i * 2654435761U % 1000U));
        y.push_back(static_cast<double>(i * 2246822519U % 1000U));
    }
    const auto kept = thin_path(x, y, 1500);
    LONGS_EQUAL(1500, kept.size());
    LONGS_EQUAL(0, kept.front());
    LONGS_EQUAL(19999, kept.back());
}

TEST_GROUP(NumberFormat){};

TEST(NumberFormat, IsWhatPeopleWrite) {
    STRCMP_EQUAL("\u221214.3839", fixed(-14.3839, 4).c_str());
    STRCMP_EQUAL("0.00", fixed(-0.001, 2).c_str());
    STRCMP_EQUAL("1.9617\u202f\u00d7\u202f10\u207b\u2076", scientific(1.9617e-6, 4).c_str());
    STRCMP_EQUAL("0.100", significant(0.09996, 3).c_str());
    STRCMP_EQUAL("7.04\u202f\u00d7\u202f10\u207b\u00b9\u00b2", significant(7.0428e-12, 3).c_str());
    STRCMP_EQUAL("12300", significant(12345, 3).c_str());
    STRCMP_EQUAL("+0.12", signed_fixed(0.12, 2).c_str());
    STRCMP_EQUAL("0.00", signed_fixed(0.001, 2).c_str());
    STRCMP_EQUAL("13.5\u202f%", percent(0.1353, 1).c_str());
    STRCMP_EQUAL("not finite", fixed(kNotANumber, 2).c_str());
}

TEST_GROUP(Page){};

TEST(Page, TextsAreEscapedAndBackTicksAreCode) {
    wheelwright::report::Page page("a < b & \"c\"", "run `x < y` and leave one ` alone");
    page.section("<script>alert(1)</script>").text("</main>");
    const std::string html = page.html();
    CHECK(html.find("<title>a &lt; b &amp; &quot;c&quot;</title>") != std::string::npos);
    CHECK(html.find("run <code>x &lt; y</code> and leave one ` alone") != std::string::npos);
    CHECK(html.find("alert(1)</script>") == std::string::npos);
    CHECK(html.find("<p>&lt;/main&gt;</p>") != std::string::npos);
}

TEST(Page, DataCannotEndTheirElement) {
    wheelwright::report::Page page("t", "l");
    page.section("s").chart({.title = "c",
                             .x = {"x"},
                             .y = {"y"},
                             .series = {{"</script><b>", {0, 1}, {kNotANumber, 2}}},
                             .caption = "",
                             .summary = "none"});
    const std::string html = page.html();
    CHECK(html.find("\\u003c/script>") != std::string::npos);
    CHECK(html.find("</script><b>") == std::string::npos);
}

TEST(Page, TheSameContentGivesTheSameBytesInASmallFile) {
    const std::string once = sample_page().html();
    CHECK(once == sample_page().html());
    std::printf("\n  sample page with 420 000 points: %zu bytes ", once.size());
    CHECK(once.size() < 700000);
}

TEST(Page, IsWrittenWithItsFoldersAndSaysWhyNot) {
    namespace fs = std::filesystem;
    const fs::path folder = fs::temp_directory_path() / "wheelwright-page-test";
    fs::remove_all(folder);
    sample_page().write(folder / "deep" / "index.html");
    CHECK(fs::file_size(folder / "deep" / "index.html") > 200000);
    std::string said;
    try {
        sample_page().write(folder / "deep" / "index.html" / "below" / "index.html");
    } catch (const std::runtime_error& error) {
        said = error.what();
    }
    CHECK(said.find("index.html") != std::string::npos);
    fs::remove_all(folder);
}
