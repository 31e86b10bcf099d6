// Progress: the best cost over time of a planner that goes on after its first solution.
#pragma once

#include <atomic>
#include <chrono>
#include <mutex>
#include <ompl/base/Planner.h>
#include <ompl/base/PlannerTerminationCondition.h>
#include <ompl/base/ProblemDefinition.h>
#include <utility>
#include <vector>

namespace trailmark {

// Planners tell of better solutions in two ways, neither known to all of them: the problem definition's callback, at
// the very moment; and a progress property, the best cost so far. The property is read within the termination
// condition, which every planner asks at least once an iteration.
class Progress {
 public:
  // Starts the clock; `limit` seconds are allowed.
  Progress(ompl::base::ProblemDefinitionPtr problem, ompl::base::PlannerPtr planner, double limit);

  // Ends the planning when the limit is reached. It must not outlive this object.
  ompl::base::PlannerTerminationCondition condition();

  // Takes note of a solution found `seconds` after the start, if it is better than those before.
  void note(double cost, double seconds);

  double elapsed() const { return std::chrono::duration<double>(Clock::now() - begin_).count(); }

  // Rows (seconds, cost), one for each better solution.
  const std::vector<std::pair<double, double>>& curve() const { return curve_; }

 private:
  using Clock = std::chrono::steady_clock;

  void poll();

  ompl::base::ProblemDefinitionPtr problem_;
  ompl::base::PlannerPtr planner_;
  ompl::base::Planner::PlannerProgressProperty best_cost_;  // empty where the planner has none
  double limit_;
  Clock::time_point begin_;
  std::atomic<double> next_poll_{0.0};
  std::mutex mutex_;  // PRM asks the condition from two threads
  std::vector<std::pair<double, double>> curve_;
};

}  // namespace trailmark
