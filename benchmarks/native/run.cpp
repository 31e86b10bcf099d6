#include "run.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <new>
#include <ompl/base/PlannerData.h>
#include <ompl/base/objectives/PathLengthOptimizationObjective.h>
#include <ompl/base/spaces/SE2StateSpace.h>
#include <ompl/geometric/PathGeometric.h>
#include <ompl/geometric/SimpleSetup.h>
#include <ompl/util/Console.h>
#include <ompl/util/RandomNumbers.h>

#include "memory.hpp"
#include "planners.hpp"
#include "progress.hpp"

namespace trailmark {
namespace {

namespace ob = ompl::base;
namespace og = ompl::geometric;
using Json = nlohmann::json;
using SE2 = ob::SE2StateSpace;

constexpr double kPi = 3.14159265358979323846;

class Validity final : public ob::StateValidityChecker {
 public:
  Validity(const ob::SpaceInformationPtr& information, const Checker& checker)
      : ob::StateValidityChecker(information), checker_(checker) {}

  bool isValid(const ob::State* state) const override {
    const auto* q = state->as<SE2::StateType>();
    return checker_.valid(q->getX(), q->getY(), q->getYaw());
  }

 private:
  const Checker& checker_;
};

std::shared_ptr<og::SimpleSetup> simple_setup(const Problem& problem, const Checker& checker,
                                              const Settings& settings) {
  auto space = std::make_shared<SE2>();
  ob::RealVectorBounds bounds(2);
  for (unsigned axis = 0; axis < 2; ++axis) {
    bounds.setLow(axis, problem.bounds[axis]);
    bounds.setHigh(axis, problem.bounds[axis + 2]);
  }
  space->setBounds(bounds);
  auto setup = std::make_shared<og::SimpleSetup>(space);
  const auto& information = setup->getSpaceInformation();
  setup->setStateValidityChecker(std::make_shared<Validity>(information, checker));
  information->setStateValidityCheckingResolution(settings.resolution / space->getMaximumExtent());
  ob::ScopedState<SE2> start(space), goal(space);
  const auto fill = [](ob::ScopedState<SE2>& state, const Configuration& q) {
    // OMPL's headings lie in [-pi, pi), trailmark's in (-pi, pi].
    state->setXY(q[0], q[1]);
    state->setYaw(q[2] >= kPi ? -kPi : q[2]);
  };
  fill(start, problem.start);
  fill(goal, problem.goal);
  setup->setStartAndGoalStates(start, goal);
  // Given explicitly, as the benchmark does for OMPL in Python: so PRM too goes on to shorten its path until the limit.
  const auto objective = std::make_shared<ob::PathLengthOptimizationObjective>(information);
  objective->setCostThreshold(ob::Cost(settings.cost_threshold));
  setup->setOptimizationObjective(objective);
  return setup;
}

Json states_of(og::PathGeometric& path) {
  Json rows = Json::array();
  for (const ob::State* state : path.getStates()) {
    const auto* q = state->as<SE2::StateType>();
    rows.push_back({q->getX(), q->getY(), q->getYaw() <= -kPi ? kPi : q->getYaw()});
  }
  return rows;
}

// OMPL's own simplification with all its defaults, as a C++ user calls it; ended after `limit` seconds.
void simplify(og::SimpleSetup& setup, double limit, Json& record) {
  og::PathGeometric path(setup.getSolutionPath());
  const auto begin = std::chrono::steady_clock::now();
  setup.getPathSimplifier()->simplify(path, limit);
  record["simplification_time"] = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  record["simplified_solution_length"] = path.length();
  record["simplified_path"] = states_of(path);
}

void solve(og::SimpleSetup& setup, const ob::PlannerPtr& planner, const Checker& checker, double limit, Json& record) {
  const double memory = restart_memory_peak();
  Progress progress(setup.getProblemDefinition(), planner, limit);
  setup.setup();
  const ob::PlannerStatus status = planner->solve(progress.condition());
  const double time = progress.elapsed();
  record["time"] = time;
  const double peak = memory_peak();
  record["memory"] = memory < 0.0 || peak < 0.0 ? Json() : Json(std::max(0.0, peak - memory));
  record["status"] = static_cast<int>(static_cast<ob::PlannerStatus::StatusType>(status));
  record["states_checked"] = checker.checked();
  record["motions_checked"] = setup.getSpaceInformation()->getCheckedMotionCount();

  const bool exact = setup.haveExactSolutionPath();
  record["solved"] = exact;
  record["approximate_solution"] = setup.haveSolutionPath() && !exact;
  if (setup.haveSolutionPath()) {
    og::PathGeometric& path = setup.getSolutionPath();
    record["solution_difference"] = setup.getProblemDefinition()->getSolutionDifference();
    record["path"] = states_of(path);
    if (exact) {
      record["solution_length"] = path.length();
      progress.note(path.length(), time);
    }
  }
  record["curve"] = Json::array();
  if (exact) {
    record["curve"] = progress.curve();
    record["time_to_first_solution"] = progress.curve().front().first;
    record["first_solution_length"] = progress.curve().front().second;
  }
}

}  // namespace

Json run(const Problem& problem, const Checker& checker, const Settings& settings) {
  ompl::msg::noOutputHandler();
  ompl::RNG::setSeed(settings.seed);
  const auto setup = simple_setup(problem, checker, settings);
  const ob::PlannerPtr planner = make_planner(settings.planner, setup->getSpaceInformation());
  setup->setPlanner(planner);
  Json record = {{"seed", settings.seed}, {"solved", false}};
  if (settings.memory_limit > 0.0) {
    limit_memory(settings.memory_limit);
  }
  const auto begin = std::chrono::steady_clock::now();
  try {
    solve(*setup, planner, checker, settings.time_limit, record);
    ob::PlannerData data(setup->getSpaceInformation());
    planner->getPlannerData(data);
    record["graph_states"] = data.numVertices();
    record["graph_motions"] = data.numEdges();
    if (setup->haveExactSolutionPath()) {
      simplify(*setup, settings.simplify_limit, record);
    }
  } catch (const std::bad_alloc&) {
    if (record.contains("status")) {
      record["failure"] = "after planning: out of memory";
    } else {
      record["status"] = static_cast<int>(ob::PlannerStatus::ABORT);
      record["failure"] = "out of memory";
      record["time"] = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    }
  }
  return record;
}

}  // namespace trailmark
