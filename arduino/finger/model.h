// The model that an image is built with: -DFINGER_MODEL='"file.h"' names a header that defines
// FINGER_CLASSIFIER, a ClassifierModel. Without the flag there is none.
#ifndef FINGER_MODEL_H
#define FINGER_MODEL_H

#include "classifier.h"

#ifdef FINGER_MODEL
#include FINGER_MODEL
const ClassifierModel *const MODEL = &FINGER_CLASSIFIER;
#else
const ClassifierModel *const MODEL = nullptr;
#endif

#endif
