// The planners of the installed OMPL that are measured, by name.
#pragma once

#include <ompl/base/Planner.h>
#include <ompl/base/SpaceInformation.h>
#include <string>
#include <vector>

namespace trailmark {

std::vector<std::string> planner_names();

// Returns the names of a planner's parameters, sorted.
std::vector<std::string> parameter_names(const std::string& name);

// Returns a planner with OMPL's default settings. Throws std::runtime_error for a name that is not there.
ompl::base::PlannerPtr make_planner(const std::string& name, const ompl::base::SpaceInformationPtr& information);

}  // namespace trailmark
