#include "firmware/task/parameter_service.hpp"

namespace wheelwright::task {
namespace {

ParameterService::Result result_of(model::ParameterStatus status) {
    switch (status) {
        case model::ParameterStatus::ok:
            return ParameterService::Result::ok;
        case model::ParameterStatus::unknown_index:
            return ParameterService::Result::unknown_index;
        case model::ParameterStatus::out_of_range:
            return ParameterService::Result::out_of_range;
        case model::ParameterStatus::not_finite:
            return ParameterService::Result::not_finite;
    }
    return ParameterService::Result::unknown_index;
}

}  // namespace

protocol::ParameterReply ParameterService::answer(const protocol::ParameterRequest& request, bool idle) {
    using protocol::ParameterOperation;
    protocol::ParameterReply reply;
    reply.operation = request.operation;
    reply.index = request.index;
    reply.value = request.value;
    switch (request.operation) {
        case ParameterOperation::read: {
            double value = 0;
            reply.result = read(request.index, value);
            reply.value = static_cast<float>(value);
            break;
        }
        case ParameterOperation::write:
            reply.result = stage(request.index, static_cast<double>(request.value));
            break;
        case ParameterOperation::commit:
            reply.result = commit(idle);
            break;
        case ParameterOperation::discard:
            reply.result = discard();
            break;
        case ParameterOperation::save:
            reply.result = save();
            reply.value = static_cast<float>(offered_);
            break;
    }
    return reply;
}

std::optional<protocol::ParameterReply> ParameterService::saved() {
    const SaveMailbox::Outcome outcome = mailbox_.outcome();
    if (outcome == SaveMailbox::Outcome::none) return std::nullopt;
    protocol::ParameterReply reply;
    reply.operation = protocol::ParameterOperation::save;
    reply.value = static_cast<float>(offered_);
    reply.result = outcome == SaveMailbox::Outcome::saved ? Result::ok : Result::save_failed;
    return reply;
}

ParameterService::Result ParameterService::read(std::uint16_t index, double& value) const {
    return result_of(model::read_parameter(live_, index, value));
}

ParameterService::Result ParameterService::stage(std::uint16_t index, double value) {
    double unused = 0;
    if (const Result known = read(index, unused); known != Result::ok) return known;
    const model::ChangeWhen when = model::changeable(index);
    if (when == model::ChangeWhen::start) return Result::read_only;
    if (staged_count_ == staged_list_.size()) return Result::not_now;
    const Result result = result_of(model::write_parameter(staged_, index, value));
    if (result != Result::ok) return result;
    staged_list_[staged_count_++] = {index, value};
    staged_needs_idle_ = staged_needs_idle_ || when == model::ChangeWhen::idle;
    return Result::ok;
}

ParameterService::Result ParameterService::commit(bool idle) {
    if (staged_count_ == 0) return Result::nothing_staged;
    if (staged_needs_idle_ && !idle) return Result::not_now;
    staged_ = live_;
    for (std::size_t i = 0; i < staged_count_; ++i) {
        model::write_parameter(staged_, staged_list_[i].index, staged_list_[i].value);
    }
    if (model::broken_order(staged_) != nullptr) return Result::out_of_range;
    live_ = staged_;
    for (std::size_t i = 0; i < staged_count_; ++i) {
        remember(staged_list_[i].index, staged_list_[i].value);
    }
    staged_count_ = 0;
    staged_needs_idle_ = false;
    changed_ = true;
    return Result::ok;
}

ParameterService::Result ParameterService::discard() {
    staged_count_ = 0;
    staged_needs_idle_ = false;
    return Result::ok;
}

ParameterService::Result ParameterService::save() {
    if (!mailbox_.offer(since_load_)) return Result::not_now;
    offered_ = since_load_.count;
    return Result::save_started;
}

void ParameterService::record(std::uint16_t index, double value) {
    if (model::write_parameter(live_, index, value) == model::ParameterStatus::ok) remember(index, value);
}

void ParameterService::remember(std::uint16_t index, double value) {
    for (std::size_t i = 0; i < since_load_.count; ++i) {
        if (since_load_.items[i].index == index) {
            since_load_.items[i].value = value;
            return;
        }
    }
    if (since_load_.count < kMaxChanged) since_load_.items[since_load_.count++] = {index, value};
}

}  // namespace wheelwright::task
