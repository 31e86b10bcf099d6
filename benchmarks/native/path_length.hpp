// PathLength: OMPL's objective of that name, with a correction for BIT* of OMPL 1.5.
#pragma once

#include <ompl/base/objectives/PathLengthOptimizationObjective.h>
#include <ompl/base/samplers/informed/PathLengthDirectInfSampler.h>

namespace trailmark {

// BIT* 1.5 draws its samples where a path through them can cost at least the distance between start and goal. In SE(2) that
// distance counts the headings' difference, but the sampler's ellipse the positions alone: with different headings at start
// and goal, an ellipse about both is never sampled, whatever the time. OMPL begins at cost 0 since 1.6 (its pull
// request 812); so does this.
class PathLength final : public ompl::base::PathLengthOptimizationObjective {
 public:
  using ompl::base::PathLengthOptimizationObjective::PathLengthOptimizationObjective;

  ompl::base::InformedSamplerPtr allocInformedStateSampler(const ompl::base::ProblemDefinitionPtr& problem,
                                                           unsigned int most) const override {
    return std::make_shared<Sampler>(problem, most);
  }

 private:
  class Sampler final : public ompl::base::PathLengthDirectInfSampler {
   public:
    using ompl::base::PathLengthDirectInfSampler::PathLengthDirectInfSampler;

    bool sampleUniform(ompl::base::State* state, const ompl::base::Cost&, const ompl::base::Cost& most) override {
      return PathLengthDirectInfSampler::sampleUniform(state, most);
    }
  };
};

}  // namespace trailmark
