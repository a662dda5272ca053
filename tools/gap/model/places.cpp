#include "tools/gap/model/places.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>

#include "tools/gap/hypotheses/torque_ripple.hpp"

namespace wheelwright::gap {
namespace {

// NOLINTBEGIN(readability-magic-numbers): shapes, not quantities
constexpr std::array kWidths_rad_per_s{0.4, 3.0};
constexpr std::array kTorqueLevels{0.05, 0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.9};  // of the peak
constexpr std::array kHighTorques{0.35, 0.6, 0.8};                              // of the peak
constexpr std::array kHighSpeeds{0.2, 0.5};                                     // of the peak
constexpr std::array kLags_s{0.005, 0.02, 0.08};
constexpr int kTimes = 7;
// NOLINTEND(readability-magic-numbers)

enum Aspects { kOnly, kBeyond, kTorqueLate, kReversal, kFirstOrder };

}  // namespace

PlaceColumns::PlaceColumns(const Setting& setting)
    : peak_torque_Nm_(setting.peak_torque_Nm),
      peak_speed_rad_per_s_(setting.peak_speed_rad_per_s),
      late_torque_(kLags_s.size()),
      late_sign_(kLags_s.size()) {}

std::span<const PlaceColumns::Kind> PlaceColumns::kinds() {
    constexpr std::size_t kPerOrder = 4;  // cosine and sine of each wheel
    constexpr std::size_t kCount = kWidths_rad_per_s.size() + kTorqueLevels.size() +
                                   kHighTorques.size() * kHighSpeeds.size() + 2 * kLags_s.size() +
                                   kPerOrder * kMostOrder + kTimes;
    static constexpr std::array<Kind, kCount> kAll = [] {
        std::array<Kind, kCount> all{};
        std::size_t n = 0;
        const auto add = [&](std::size_t count, std::string_view place, int aspect) {
            for (std::size_t i = 0; i < count; ++i) all[n++] = {place, aspect};
        };
        add(kWidths_rad_per_s.size(), "low wheel speed", kOnly);
        add(kTorqueLevels.size(), "torque", kBeyond);
        add(kHighTorques.size() * kHighSpeeds.size(), "torque times speed", kBeyond);
        add(kLags_s.size(), "lag", kTorqueLate);
        add(kLags_s.size(), "lag", kReversal);
        for (int order = 1; order <= kMostOrder; ++order) add(kPerOrder, "wheel angle", kFirstOrder + order);
        add(kTimes, "time", kOnly);
        return all;
    }();
    return kAll;
}

void PlaceColumns::append(const Interval& i, std::vector<WheelPair<double>>& values) {
    const WheelPair<double> speed = i.speed();
    if (first_) start(i);
    for (const double width : kWidths_rad_per_s) {
        const auto one = [&](double w) { return sign_of(w) * std::exp(-std::pow(w / width, 2)); };
        values.push_back({one(speed.left), one(speed.right)});
    }
    const auto beyond = [&](double torque, double level) {
        return sign_of(torque) * std::max(0.0, std::abs(torque) - level * peak_torque_Nm_);
    };
    for (const double level : kTorqueLevels)
        values.push_back({beyond(i.torque.left, level), beyond(i.torque.right, level)});
    for (const double level : kHighTorques) {
        for (const double fast : kHighSpeeds) {
            const auto one = [&](double torque, double w) {
                return std::max(0.0, sign_of(torque) * w / peak_speed_rad_per_s_ - fast) *
                       beyond(torque, level);
            };
            values.push_back({one(i.torque.left, speed.left), one(i.torque.right, speed.right)});
        }
    }
    for (const WheelPair<double>& late : late_torque_)
        values.push_back({late.left - i.torque.left, late.right - i.torque.right});
    for (const WheelPair<double>& late : late_sign_)
        values.push_back({late.left - sign_of(i.torque.left), late.right - sign_of(i.torque.right)});
    // an angle's harmonics by recurrence
    const std::complex<double> left = std::polar(1.0, i.angle.left);
    const std::complex<double> right = std::polar(1.0, i.angle.right);
    std::complex<double> l = left;
    std::complex<double> r = right;
    for (int order = 1; order <= kMostOrder; ++order, l *= left, r *= right) {
        values.push_back({l.real(), 0});
        values.push_back({l.imag(), 0});
        values.push_back({0, r.real()});
        values.push_back({0, r.imag()});
    }
    for (int k = 1; k <= kTimes; ++k)
        values.push_back(i.t_s * (kTimes + 1) > k * i.span_s ? i.torque : WheelPair<double>{});
}

void PlaceColumns::start(const Interval& i) {
    first_ = false;
    std::fill(late_torque_.begin(), late_torque_.end(), i.torque);
    std::fill(late_sign_.begin(), late_sign_.end(),
              WheelPair<double>{sign_of(i.torque.left), sign_of(i.torque.right)});
}

void PlaceColumns::advance(const Interval& i) {
    if (first_) start(i);
    for (std::size_t k = 0; k < kLags_s.size(); ++k) {
        const double share = i.dt_s / (i.dt_s + kLags_s[k]);
        late_torque_[k].left += share * (i.torque.left - late_torque_[k].left);
        late_torque_[k].right += share * (i.torque.right - late_torque_[k].right);
        late_sign_[k].left += share * (sign_of(i.torque.left) - late_sign_[k].left);
        late_sign_[k].right += share * (sign_of(i.torque.right) - late_sign_[k].right);
    }
}

std::vector<Aspect> aspects_of(const Dictionary& dictionary) {
    std::vector<Aspect> all;
    const auto columns = dictionary.columns();
    for (auto [c, end] = dictionary.rich_columns(); c < end; ++c) {
        const std::string_view place = columns[std::size_t(c)].place;
        if (all.empty() || all.back().place != place) all.push_back({place, {}});
        all.back().columns.push_back(c);
    }
    const std::vector<Aspect> rich = all;
    const auto first = dictionary.place_columns().first;
    const std::span<const PlaceColumns::Kind> kinds = PlaceColumns::kinds();
    for (std::size_t i = 0; i < kinds.size(); ++i) {
        if (i == 0 || kinds[i].place != kinds[i - 1].place || kinds[i].aspect != kinds[i - 1].aspect) {
            all.push_back({kinds[i].place, {}});
            if (kinds[i].aspect == kBeyond || kinds[i].aspect == kOnly) {
                for (const Aspect& r : rich) {
                    if (r.place == kinds[i].place) all.back().columns = r.columns;
                }
            }
        }
        all.back().columns.push_back(first + static_cast<int>(i));
    }
    // what is late shows as a timing beyond the one that a log may have
    for (Aspect& aspect : all) {
        if (aspect.place == "lag") aspect.columns.push_back(Dictionary::kTiming);
    }
    all.push_back({"lag", {Dictionary::kTiming}});
    return all;
}

}  // namespace wheelwright::gap
