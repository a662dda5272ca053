#include "tools/gap_exam/exam.hpp"

#include <filesystem>
#include <stdexcept>

#include "firmware/task/write_file.hpp"
#include "tools/cli/in_parallel.hpp"
#include "tools/gap_bench/corpus.hpp"

namespace wheelwright::exam {
namespace {

namespace fs = std::filesystem;

void write(const std::string& path, const std::string& text) {
    if (const std::string failed = task::write_whole_file(path, text); !failed.empty())
        throw std::runtime_error(failed);
}

Answered answer_one(const ExamOptions& options, std::size_t number) {
    Answered done{draw_log(options.seed, number), {}, {}};
    ExamLog& log = done.log;
    const std::string folder = options.out + "/" + std::to_string(number);
    fs::create_directories(folder);
    fs::remove(folder + "/truth.json");  // of an exam before, which the analysis must not find
    bench::GapQuestion question;
    question.program = options.program;
    question.logs = {folder + "/learned.csv"};
    const std::string held_out = folder + "/held_out.csv";
    question.held_out = {"--heldout", held_out};
    question.out = folder + "/gap";
    const double radius_m = log.robot.mean_radius_m();
    question.geometry = {{radius_m, radius_m}, log.robot.track_m};
    write(question.logs.front(), csv(log.learned));
    write(held_out, csv(log.held_out));

    tools::LogReading reading;
    reading.wheel_radius_m = question.geometry.wheel_radius_m;
    const std::vector<bench::CorpusRun> runs = bench::read_runs(held_out, reading);
    if (!runs.front().unusable.empty()) throw std::runtime_error(runs.front().unusable);
    std::vector<bench::Piece> pieces;
    for (const tools::MeasuredLog& segment : runs.front().segments)
        pieces.push_back({&segment, 0, segment.samples.size()});
    done.answer = bench::ask_gap(question, pieces);
    done.judged = judge(log, done.answer);
    write(folder + "/truth.json", truth_json(log));
    log.learned.rows.clear();
    log.learned.rows.shrink_to_fit();
    log.held_out.rows.clear();
    log.held_out.rows.shrink_to_fit();
    return done;
}

}  // namespace

std::vector<Answered> hold_exam(const ExamOptions& options,
                                const std::function<void(const tools::CampaignProgress&)>& progress) {
    std::vector<Answered> answers(options.numbers.size());
    tools::in_parallel(answers.size(), options.jobs, progress, [&](std::size_t i) {
        answers[i] = answer_one(options, options.numbers[i]);
        const std::string said =
            answers[i].answer.refusal.empty() ? answers[i].answer.verdict : answers[i].answer.refusal;
        return "log " + std::to_string(options.numbers[i]) + ": " + said;
    });
    return answers;
}

}  // namespace wheelwright::exam
