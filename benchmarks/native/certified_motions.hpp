// CertifiedMotions: OMPL's motion validator by bisection of clearances. It has no resolution and misses no collision.
#pragma once

#include <ompl/base/MotionValidator.h>
#include <ompl/base/SpaceInformation.h>
#include <utility>

#include "checker.hpp"

namespace trailmark {

class CertifiedMotions final : public ompl::base::MotionValidator {
 public:
  // checker: one that measures clearances.
  CertifiedMotions(const ompl::base::SpaceInformationPtr& information, const Checker& checker, const Robot& robot);

  bool checkMotion(const ompl::base::State* a, const ompl::base::State* b) const override;

  // The last state known to be valid is `a`, unless all of the motion is.
  bool checkMotion(const ompl::base::State* a, const ompl::base::State* b,
                   std::pair<ompl::base::State*, double>& last_valid) const override;

 private:
  bool certified(const ompl::base::State* a, const ompl::base::State* b) const;
  double clearance(const ompl::base::State* state) const;
  double reach(const ompl::base::State* a, const ompl::base::State* b) const;

  const Checker& checker_;
  double turning_radius_;  // of a car, metres; 0 for a robot that moves straight
  double reach_;           // of the robot's points from its reference point where turning moves them, metres
};

}  // namespace trailmark
