#include "planners.hpp"

#include <functional>
#include <map>
#include <ompl/base/spaces/SE2StateSpace.h>
#include <ompl/geometric/planners/informedtrees/AITstar.h>
#include <ompl/geometric/planners/informedtrees/BITstar.h>
#include <ompl/geometric/planners/prm/LazyPRMstar.h>
#include <ompl/geometric/planners/prm/PRM.h>
#include <ompl/geometric/planners/prm/PRMstar.h>
#include <ompl/geometric/planners/rrt/InformedRRTstar.h>
#include <ompl/geometric/planners/rrt/RRTConnect.h>
#include <ompl/geometric/planners/rrt/RRTstar.h>
#include <stdexcept>

namespace trailmark {
namespace {

namespace ob = ompl::base;
namespace og = ompl::geometric;

using Maker = std::function<ob::PlannerPtr(const ob::SpaceInformationPtr&)>;

template <typename Planner>
ob::PlannerPtr make(const ob::SpaceInformationPtr& information) {
  return std::make_shared<Planner>(information);
}

const std::map<std::string, Maker>& makers() {
  static const std::map<std::string, Maker> table = {
      {"AITstar", make<og::AITstar>},       {"BITstar", make<og::BITstar>},
      {"InformedRRTstar", make<og::InformedRRTstar>}, {"LazyPRMstar", make<og::LazyPRMstar>},
      {"PRM", make<og::PRM>},               {"PRMstar", make<og::PRMstar>},
      {"RRTConnect", make<og::RRTConnect>}, {"RRTstar", make<og::RRTstar>},
  };
  return table;
}

}  // namespace

std::vector<std::string> planner_names() {
  std::vector<std::string> names;
  for (const auto& entry : makers()) {
    names.push_back(entry.first);
  }
  return names;
}

ob::PlannerPtr make_planner(const std::string& name, const ob::SpaceInformationPtr& information) {
  const auto found = makers().find(name);
  if (found == makers().end()) {
    std::string allowed;
    for (const std::string& known : planner_names()) {
      allowed += (allowed.empty() ? "" : ", ") + known;
    }
    throw std::runtime_error("planner '" + name + "' given, allowed: " + allowed);
  }
  return found->second(information);
}

std::vector<std::string> parameter_names(const std::string& name) {
  const auto information = std::make_shared<ob::SpaceInformation>(std::make_shared<ob::SE2StateSpace>());
  std::vector<std::string> names;
  make_planner(name, information)->params().getParamNames(names);
  return names;
}

}  // namespace trailmark
