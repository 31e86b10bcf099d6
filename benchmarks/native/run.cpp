#include "run.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <map>
#include <new>
#include <stdexcept>
#include <string>
#include <ompl/base/PlannerData.h>
#include <ompl/base/spaces/DubinsStateSpace.h>
#include <ompl/base/spaces/ReedsSheppStateSpace.h>
#include <ompl/base/spaces/SE2StateSpace.h>
#include <ompl/geometric/PathGeometric.h>
#include <ompl/geometric/SimpleSetup.h>
#include <ompl/util/Console.h>
#include <ompl/util/RandomNumbers.h>

#include "certified_motions.hpp"
#include "memory.hpp"
#include "path_length.hpp"
#include "planners.hpp"
#include "progress.hpp"

namespace trailmark {
namespace {

namespace ob = ompl::base;
namespace og = ompl::geometric;
using Json = nlohmann::json;
using SE2 = ob::SE2StateSpace;

constexpr double kPi = 3.14159265358979323846;
constexpr double kPiece = 0.05;         // of the turning radius, between two states of a car's path
constexpr double kMostStates = 50000.0;

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

// Cars plan on OMPL's own curves: Reeds-Shepp's, or Dubins' for those that only drive forwards.
std::shared_ptr<SE2> space_of(const Robot& robot) {
  if (robot.turning_radius <= 0.0) {
    return std::make_shared<SE2>();
  }
  if (robot.reverse) {
    return std::make_shared<ob::ReedsSheppStateSpace>(robot.turning_radius);
  }
  return std::make_shared<ob::DubinsStateSpace>(robot.turning_radius);
}

void fill(ob::ScopedState<SE2>& state, const Configuration& q) {
  // OMPL's headings lie in [-pi, pi), trailmark's in (-pi, pi].
  state->setXY(q[0], q[1]);
  state->setYaw(q[2] >= kPi ? -kPi : q[2]);
}

std::shared_ptr<og::SimpleSetup> simple_setup(const Problem& problem, const Checker& checker,
                                              const Settings& settings) {
  const std::shared_ptr<SE2> space = space_of(problem.robot);
  ob::RealVectorBounds bounds(2);
  for (unsigned axis = 0; axis < 2; ++axis) {
    bounds.setLow(axis, problem.bounds[axis]);
    bounds.setHigh(axis, problem.bounds[axis + 2]);
  }
  space->setBounds(bounds);
  auto setup = std::make_shared<og::SimpleSetup>(space);
  const auto& information = setup->getSpaceInformation();
  setup->setStateValidityChecker(std::make_shared<Validity>(information, checker));
  if (settings.certified) {
    information->setMotionValidator(std::make_shared<CertifiedMotions>(information, checker, problem.robot));
  } else {
    information->setStateValidityCheckingResolution(settings.resolution / space->getMaximumExtent());
  }
  ob::ScopedState<SE2> start(space), goal(space);
  fill(start, problem.start);
  fill(goal, problem.goal);
  setup->setStartAndGoalStates(start, goal);
  // Given explicitly, as the benchmark does for OMPL in Python: so PRM too goes on to shorten its path until the limit.
  const auto objective = std::make_shared<PathLength>(information);
  objective->setCostThreshold(ob::Cost(settings.cost_threshold));
  setup->setOptimizationObjective(objective);
  return setup;
}

// A car's path as states so near one another that there is one shortest curve from each to the next: between distant ones
// OMPL may have taken another than whoever reads the path.
Json states_of(const og::PathGeometric& found, const Robot& robot) {
  og::PathGeometric path(found);
  if (robot.turning_radius > 0.0) {
    const double pieces = path.length() / (kPiece * robot.turning_radius);
    path.interpolate(static_cast<unsigned>(std::min(pieces, kMostStates)) + 2);
  }
  Json rows = Json::array();
  for (const ob::State* state : path.getStates()) {
    const auto* q = state->as<SE2::StateType>();
    rows.push_back({q->getX(), q->getY(), q->getYaw() <= -kPi ? kPi : q->getYaw()});
  }
  return rows;
}

// OMPL's own simplification with all its defaults, as a C++ user calls it; ended after `limit` seconds.
void simplify(og::SimpleSetup& setup, const Robot& robot, double limit, Json& record) {
  og::PathGeometric path(setup.getSolutionPath());
  const auto begin = std::chrono::steady_clock::now();
  setup.getPathSimplifier()->simplify(path, limit);
  record["simplification_time"] = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  record["simplified_solution_length"] = path.length();
  record["simplified_path"] = states_of(path, robot);
}

void set_parameter(ob::Planner& planner, const std::string& name, const std::string& value) {
  bool done = false;
  try {
    done = planner.params().hasParam(name) && planner.params().setParam(name, value);
  } catch (const std::exception&) {  // which OMPL throws for some values, and answers others with false
  }
  if (!done) {
    throw std::runtime_error("parameter " + name + "=" + value + " given, allowed: a name and a value of the planner's");
  }
}

ob::PlannerPtr planner_for(og::SimpleSetup& setup, const Settings& settings) {
  const ob::PlannerPtr planner = make_planner(settings.planner, setup.getSpaceInformation());
  for (const auto& [name, value] : settings.parameters) {
    set_parameter(*planner, name, value);
  }
  setup.setPlanner(planner);
  return planner;
}

// Plans the same problem for a moment with another seed, which no clock measures: so memory is mapped and caches are warm
// when planning begins, as in a program that has planned before.
void settle(const Problem& problem, const Checker& checker, const Settings& settings) {
  ompl::RNG::setSeed(settings.seed + 1000000007u);
  const auto setup = simple_setup(problem, checker, settings);
  const ob::PlannerPtr planner = planner_for(*setup, settings);
  setup->setup();
  planner->solve(ob::timedPlannerTerminationCondition(settings.settle));
}

// The planner's parameters as they are when it has been set up: some follow from the problem.
std::string parameters_of(const ob::Planner& planner) {
  std::map<std::string, std::string> values;
  planner.params().getParams(values);
  std::string text;
  for (const auto& [name, value] : values) {
    text += (text.empty() ? "" : ",") + name + "=" + value;
  }
  return text;
}

void solve(og::SimpleSetup& setup, const ob::PlannerPtr& planner, const Checker& checker, const Robot& robot,
           double limit, Json& record) {
  const double memory = restart_memory_peak();
  const auto before = checker.checked();
  Progress progress(setup.getProblemDefinition(), planner, limit);
  setup.setup();
  record["parameters"] = parameters_of(*planner);
  const ob::PlannerStatus status = planner->solve(progress.condition());
  const double time = progress.elapsed();
  record["time"] = time;
  const double peak = memory_peak();
  record["memory"] = memory < 0.0 || peak < 0.0 ? Json() : Json(std::max(0.0, peak - memory));
  record["status"] = static_cast<int>(static_cast<ob::PlannerStatus::StatusType>(status));
  record["states_checked"] = checker.checked() - before;
  record["motions_checked"] = setup.getSpaceInformation()->getCheckedMotionCount();

  const bool exact = setup.haveExactSolutionPath();
  record["solved"] = exact;
  record["approximate_solution"] = setup.haveSolutionPath() && !exact;
  if (setup.haveSolutionPath()) {
    og::PathGeometric& path = setup.getSolutionPath();
    record["solution_difference"] = setup.getProblemDefinition()->getSolutionDifference();
    record["path"] = states_of(path, robot);
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

std::string certified(const Problem& problem, const Checker& checker, const std::vector<Configuration>& ends) {
  ompl::msg::noOutputHandler();
  Settings settings;
  settings.certified = true;
  const auto setup = simple_setup(problem, checker, settings);
  const auto& information = setup->getSpaceInformation();
  information->setup();
  ob::ScopedState<SE2> a(information), b(information);
  std::string answers;
  for (std::size_t i = 1; i < ends.size(); i += 2) {
    fill(a, ends[i - 1]);
    fill(b, ends[i]);
    answers += information->checkMotion(a.get(), b.get()) ? '1' : '0';
  }
  return answers;
}

Json run(const Problem& problem, const Checker& checker, const Settings& settings) {
  ompl::msg::noOutputHandler();
  if (settings.settle > 0.0) {
    settle(problem, checker, settings);
  }
  ompl::RNG::setSeed(settings.seed);
  const auto setup = simple_setup(problem, checker, settings);
  const ob::PlannerPtr planner = planner_for(*setup, settings);
  Json record = {{"seed", settings.seed}, {"solved", false}};
  if (settings.memory_limit > 0.0) {
    limit_memory(settings.memory_limit);
  }
  const auto begin = std::chrono::steady_clock::now();
  try {
    solve(*setup, planner, checker, problem.robot, settings.time_limit, record);
    ob::PlannerData data(setup->getSpaceInformation());
    planner->getPlannerData(data);
    record["graph_states"] = data.numVertices();
    record["graph_motions"] = data.numEdges();
    if (setup->haveExactSolutionPath()) {
      simplify(*setup, problem.robot, settings.simplify_limit, record);
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
