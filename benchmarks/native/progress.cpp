#include "progress.hpp"

#include <cmath>
#include <cstdlib>

namespace trailmark {
namespace {

namespace ob = ompl::base;

constexpr double kPeriod = 2e-4;  // seconds between two looks at the best cost; one takes less than a microsecond

// Progress costs come with six decimals: what is nearer than this is the same solution.
constexpr double kSame = 2e-6;

}  // namespace

Progress::Progress(ob::ProblemDefinitionPtr problem, ob::PlannerPtr planner, double limit)
    : problem_(std::move(problem)), planner_(std::move(planner)), limit_(limit) {
  for (const auto& [name, property] : planner_->getPlannerProgressProperties()) {
    if (name.rfind("best cost", 0) == 0) {
      best_cost_ = property;
    }
  }
  problem_->setIntermediateSolutionCallback(
      [this](const ob::Planner*, const std::vector<const ob::State*>&, const ob::Cost cost) {
        note(cost.value(), elapsed());
      });
  begin_ = Clock::now();
}

ob::PlannerTerminationCondition Progress::condition() {
  return ob::PlannerTerminationCondition([this] {
    const double now = elapsed();
    if (best_cost_ && now >= next_poll_.load(std::memory_order_relaxed)) {
      next_poll_.store(now + kPeriod, std::memory_order_relaxed);
      poll();
    }
    return now >= limit_;
  });
}

void Progress::poll() { note(std::strtod(best_cost_().c_str(), nullptr), elapsed()); }

void Progress::note(double cost, double seconds) {
  if (!std::isfinite(cost)) {
    return;
  }
  const std::lock_guard<std::mutex> lock(mutex_);
  if (curve_.empty() || cost < curve_.back().second - kSame) {
    curve_.emplace_back(seconds, cost);
  }
}

}  // namespace trailmark
