// The model that an image is built with: -DFINGER_MODEL='"file.h"' names a header that defines
// FINGER_CLASSIFIER, a ClassifierModel. The Arduino IDE has no such flag: there the header lies in the
// sketch as trained_model.h. Without either there is none.
#ifndef FINGER_MODEL_H
#define FINGER_MODEL_H

#include "classifier.h"

#if !defined FINGER_MODEL && __has_include("trained_model.h")
#define FINGER_MODEL "trained_model.h"
#endif

#ifdef FINGER_MODEL
#include FINGER_MODEL
const ClassifierModel *const MODEL = &FINGER_CLASSIFIER;
#else
const ClassifierModel *const MODEL = nullptr;
#endif

#endif
