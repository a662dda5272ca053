// compare HOST TARGET: what the firmware has sent in double on a host and in float on a bare machine, frame
// by frame (recording.hpp). The same frames must have been sent by the same cycles; in each every bit and
// number is to be the same, but for physical values: one that the message rounds may round to the
// neighbouring step, a float may differ by its share in kFloat. Prints the largest differences by message.
// Exit status 0 when they agree, 3 when not.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <iterator>
#include <map>
#include <string>
#include <vector>

#include "drivers/odrive/odrive_0_6_messages.hpp"
#include "tests/m7/recording.hpp"

namespace {

using namespace wheelwright;
using protocol::CodecStatus;
using protocol::FieldInfo;

constexpr double kFloat = 1e-3;  // what the torques are allowed, too

struct Field {
    bool exact = true;
    long long compared = 0, differ = 0;
    double most = 0;  // in steps, or as a share of the value
};
struct Judge {
    std::map<std::string, std::map<std::string, Field>> found;
    long long wrong = 0;

    template <typename M>
    void frames(const m7::Frame& a, const m7::Frame& b) {
        M left, right;
        if (M::decode({a.data.data(), a.length}, left) != CodecStatus::ok ||
            M::decode({b.data.data(), b.length}, right) != CodecStatus::ok) {
            ++wrong;
            return;
        }
        std::vector<double> values;
        M::for_each_field(left, [&](const FieldInfo&, const auto& x) { values.push_back(double(x)); });
        auto value = values.begin();
        auto& message = found[std::string(M::name)];
        M::for_each_field(right, [&](const FieldInfo& info, const auto& x) {
            using T = std::decay_t<decltype(x)>;
            const double was = *value++, off = double(x) == was ? 0 : std::abs(double(x) - was);
            Field& field = message[std::string(info.name)];
            field.exact = !std::is_floating_point_v<T>;
            ++field.compared;
            field.differ += off != 0;
            double scale = 1, allowed = 0;
            if constexpr (std::is_same_v<T, double>) {
                scale = info.step;
                allowed = 1.5;  // one
            } else if constexpr (std::is_same_v<T, float>) {
                scale = std::max(std::abs(was), 1e-30);
                allowed = kFloat;
            }
            field.most = std::max(field.most, off / scale);
            wrong += !(off / scale <= allowed);  // nor is NaN
        });
    }
};

std::vector<m7::Frame> read(const char* path) {
    std::ifstream file(path, std::ios::binary);
    const std::vector<char> bytes{std::istreambuf_iterator<char>(file), {}};
    std::vector<m7::Frame> frames(bytes.size() / sizeof(m7::Frame));
    std::copy_n(bytes.data(), frames.size() * sizeof(m7::Frame), reinterpret_cast<char*>(frames.data()));
    return frames;
}

}  // namespace

int main(int argc, char** argv) {
    if (argc != 3) return 1;
    const std::vector<m7::Frame> host = read(argv[1]), target = read(argv[2]);
    Judge judge;
    std::size_t i = 0;
    for (; i < std::min(host.size(), target.size()); ++i) {
        const m7::Frame &a = host[i], &b = target[i];
        if (a.time_ns != b.time_ns || a.id != b.id || a.length != b.length) break;
        bool known = false;
        protocol::AllMessages::for_each([&]<typename M>() {
            if (a.id == M::id) judge.frames<M>(a, b), known = true;
        });
        if (a.id < protocol::EmergencyStop::id)
            drivers::odrive_0_6::AllMessages::for_each([&]<typename M>() {
                if ((a.id & 0x1FU) == M::command && a.length == M::length)
                    judge.frames<M>(a, b), known = true;
            });
        judge.wrong += !known && a.data != b.data;
    }
    const bool same = i == host.size() && i == target.size() && i > 0;
    if (!same) std::printf("frame %zu of %zu and %zu is another one\n", i, host.size(), target.size());
    for (const auto& [name, fields] : judge.found)
        for (const auto& [field, f] : fields)
            if (f.differ > 0)
                std::printf("%-20s %-28s differs in %7lld of %7lld, by at most %.2g %s\n", name.c_str(),
                            field.c_str(), f.differ, f.compared, f.most,
                            f.exact        ? ""
                            : f.most > 0.5 ? "steps"
                                           : "of itself");
    std::printf("frames sent: %zu, the same ones by the same cycles%s; values beyond what is allowed: %lld\n",
                i, same ? "" : ": NO", judge.wrong);
    return same && judge.wrong == 0 ? 0 : 3;
}
